"""Wording shared by the sentences of reports."""

from __future__ import annotations

import math
from collections.abc import Sequence

FEATURES = (("part", "parts"), ("tunnel", "tunnels"), ("cavity", "cavities"))
"""What a solid is counted by: one of each, and several."""


def plural(count: int, one: str, many: str | None = None) -> str:
    """The count with its noun: "1 vertex", "2 vertices"."""
    return f"{count} {one if count == 1 else many or one + 's'}"


def position(values: Sequence[float], scale: float) -> str:
    """Coordinates with three digits below `scale`, so that large offsets hide nothing: "(596612.41, 188817.05)"."""
    decimals = min(max(0, 3 - math.floor(math.log10(scale))), 12) if 0 < scale < math.inf else 6
    return "(" + ", ".join(f"{value:.{decimals}f}" for value in values) + ")"
