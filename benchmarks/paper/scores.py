"""Settings of Table II, and how its values are scored."""

from __future__ import annotations

import math
from dataclasses import dataclass

from benchmarks.paper.printed import SETTINGS

Value = float | int | None


@dataclass(frozen=True)
class Setting:
    """Number of points, and noise in units of half the longest side."""

    n_points: int
    noise: float = 0.0

    @property
    def text(self) -> str:
        points = f"{self.n_points // 1000} k" if self.n_points % 1000 == 0 else f"{self.n_points}"
        return points + (f", noise {self.noise / 2:.2%}" if self.noise else "")


ROW_SETTINGS = {
    **dict(zip(SETTINGS, (Setting(5_000), Setting(10_000), Setting(10_000, 0.025)), strict=True)),
    "10 k, noise 0.01": Setting(10_000, 0.01),
}
"""The paper's settings, and one with less noise."""


def is_right(value: Value, euler: int) -> bool:
    """Whether an integer is χ, or another value rounds to it as the paper rounds: 2·round(χ/2)."""
    if value is None or isinstance(value, int):
        return value == euler
    return math.isfinite(value) and 2 * round(value / 2) == euler


def errors(pairs: list[tuple[Value, int]]) -> list[float]:
    """|value − χ| wherever there is a value."""
    return [abs(value - euler) for value, euler in pairs if value is not None and math.isfinite(value)]


def near(pairs: list[tuple[Value, int]]) -> int:
    """How many values are within ½ of χ."""
    return sum(error < 0.5 for error in errors(pairs))
