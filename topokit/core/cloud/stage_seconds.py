"""What the stages of a look at a cloud cost, for the bar that shows progress."""

from __future__ import annotations

from topokit.core.cloud.dense import MOST_POINTS

_SECONDS = {"neighborhoods": 0.1, "orientation": 3.3, "counting": 1.9}  # of 10 000 points, on one processor
_PER_MILLION = {"neighborhoods": 3.1, "signs": 2.5, "samples": 2.6, "counting": 1.2}  # seconds more of large clouds
_FIXED = {"orientation": 1.0, "counting": 2.0}  # seconds for the samples of large clouds


def stage_seconds(n_points: int) -> dict[str, float]:
    """The stages of a look at so many points in their order, and about how many seconds each takes."""
    if n_points <= MOST_POINTS:
        return {name: seconds * n_points / 10_000 for name, seconds in _SECONDS.items()}
    growing = {name: seconds * n_points / 1e6 for name, seconds in _PER_MILLION.items()}
    names = ("neighborhoods", "signs", "samples", "orientation", "counting")
    return {name: growing.get(name, 0.0) + _FIXED.get(name, 0.0) for name in names}
