"""Witnesses made by hand: in full agreement on a sphere, but for what a test changes by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from topokit.core.cloud.solid.wires import WireReading
from topokit.core.cloud.votes import SampleQuality, Vote
from topokit.core.cloud.witness import Signs, Witness

_COUNTS = {"cut": (3, 2), "coarse cut": (4, 2), "shifted cut": (2, 2), "field": (3, 1)}
"""Settings of each family, and values of each vote."""


def votes_of(values: Mapping[str, int]) -> tuple[Vote, ...]:
    """The votes of some families, all settings of each with one integer."""
    return tuple(
        Vote(family, setting, (euler,) * _COUNTS[family][1])  # type: ignore[arg-type]
        for family, euler in values.items()
        for setting in range(_COUNTS[family][0])
    )


def a_witness(
    *,
    votes: Mapping[str, int] | tuple[Vote, ...] | None = None,
    quality: Mapping[str, float] | None = None,
    **changes: Any,
) -> Witness:
    """A witness that sees a sphere.

    Args:
        votes: the integer of each family of votes, or the votes themselves.
        quality: fields of `SampleQuality` that differ from those of clean samples.
        changes: fields of `Witness` that differ.
    """
    votes = {"cut": 2, "coarse cut": 2, "field": 2} if votes is None else votes
    clean = SampleQuality(coverage=1.0, roughness=0.1, crowded_wide=0.0, double=0.0)
    seen = Witness(
        euler=2,
        agreement=1.0,
        votes=votes if isinstance(votes, tuple) else votes_of(votes),
        quality=replace(clean, **(quality or {})),
        signs=Signs("given", 1.0, None),
        components=1,
        cavities=0,
        normals=np.zeros((9, 3)),
        n_points=900,
        n_used=900,
        spacing=1.0,
        resolution=2.5,
        seconds={"votes": 0.0},
        surface=None,
    )
    return replace(seen, **changes)


def a_wire(**changes: Any) -> WireReading:
    """A clear reading as a wire of one piece."""
    clear = WireReading(
        euler=2,
        components=1,
        smallest=1.0,
        largest=4.0,
        share=0.8,
        contrast=10.0,
        narrowness=0.1,
        normals=np.zeros((9, 3)),
        n_stray=0,
        seconds=0.0,
    )
    return replace(clear, **changes)
