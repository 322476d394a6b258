"""Samples moved along their normals, so that thin walls and narrow gaps are as wide as the samples can resolve.

Where two sheets are closer than the sample spacing, tetrahedra join the wrong ones. A shift outward thickens the wall
between them, a shift inward widens the gap, and neither changes the topology as long as the way is free. Several shifts
compete. All samples lie on the surface, so that shift is the best whose cuts leave the fewest of them off it. This
needs normals that are known. Found ones fit the solid that they were found with, so that it misses few samples even
where it is wrong: every shift corrects them first, and of the shifts whose own cuts agree those count whose integer
most cuts give.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from topokit.core.cloud.delaunay_cut import Cut, DelaunayComplex, cut_complex, delaunay_complex
from topokit.core.cloud.neighborhoods import LocalGeometry, local_geometry, opposite_neighbors
from topokit.core.cloud.poles import normals_by_poles
from topokit.core.cloud.votes import CUT_SETTINGS, Vote, surface_eulers

Floats = NDArray[np.float64]

_SHIFTS = (0.3, 0.6)  # in spacings; a wall without thickness needs about one spacing to be resolved
_FREE = 3.0  # spacings beyond which another sheet does not matter
_NEAR = 1.5  # spacings up to which it may be joined to the wrong side
_SIDEWAYS = 0.7  # spacings by which the opposite sample of a sheet may lie aside
_SMOOTHED_OVER = 8  # neighbors over which the shifts are averaged, twice


@dataclass(frozen=True, eq=False)
class Widening:
    """Samples at the positions that show the surface best.

    Attributes:
        points: (N, 3), shifted positions.
        normals: (N, 3), unit, outward; corrected if they were found.
        local: neighborhoods of these positions.
        complex_: their tetrahedra.
        cuts: of these, with the first settings.
        others: votes of the positions that were not taken.
        is_shifted: whether the positions differ from those given.
    """

    points: Floats
    normals: Floats
    local: LocalGeometry
    complex_: DelaunayComplex
    cuts: tuple[Cut, ...]
    others: tuple[Vote, ...]
    is_shifted: bool


@dataclass(frozen=True, eq=False)
class _Trial:
    """Samples at some positions (N, 3) with normals, cuts there, what these count, and the share that they miss."""

    points: Floats
    normals: Floats
    local: LocalGeometry
    complex_: DelaunayComplex
    cuts: tuple[Cut, ...]
    eulers: tuple[tuple[int, ...], ...]
    missed: float

    @property
    def votes(self) -> list[Vote]:
        return [Vote("shifted cut", k, eulers, len(self.points)) for k, eulers in enumerate(self.eulers)]


def widened(
    points: Floats,
    normals: Floats,
    local: LocalGeometry,
    complex_: DelaunayComplex,
    cut: Cut,
    *,
    are_found: bool,
    axes: Floats | None = None,
) -> Widening:
    """The positions, shifted or not, that show the surface best.

    Args:
        points: (N, 3).
        normals: (N, 3), unit, outward.
        local: neighborhoods of the points.
        complex_: tetrahedra of the points.
        cut: of these with the normals and the weights by default.
        are_found: whether the normals were found rather than given; then every shift corrects them.
        axes: (N, 3), unit normals of arbitrary sign, where known; then only signs are corrected.
    """
    trials = [_trial(points, normals, local, complex_, cut)]
    with ThreadPoolExecutor(1) as thread:  # flows hold the interpreter's lock, tetrahedra do not
        for moved, around, room in thread.map(partial(_moved, points, normals, local), _shifts(points, normals, local)):
            turned, its_cut = normals, cut_complex(room, normals)
            if are_found:
                turned, its_cut = normals_by_poles(room, normals, its_cut, rounds=1, axes=axes)
            trials.append(_trial(moved, turned, around, room, its_cut))
    best = min(_of_most_cuts(trials) if are_found else trials, key=lambda trial: trial.missed)
    others = tuple(vote for trial in trials if trial is not best for vote in trial.votes)
    is_shifted = best is not trials[0]
    return Widening(best.points, best.normals, best.local, best.complex_, best.cuts, others, is_shifted)


def _of_most_cuts(trials: Sequence[_Trial]) -> list[_Trial]:
    """Of those whose own cuts agree, those with the integer that most cuts of all give; the first if there is none."""
    counts = Counter(euler for trial in trials for eulers in trial.eulers for euler in eulers)
    steady = [trial for trial in trials if len(set(chain(*trial.eulers))) == 1]
    most = max((counts[trial.eulers[0][0]] for trial in steady), default=0)
    return [trial for trial in steady if counts[trial.eulers[0][0]] == most] or [trials[0]]


def _trial(points: Floats, normals: Floats, local: LocalGeometry, complex_: DelaunayComplex, first: Cut) -> _Trial:
    cuts = (first, cut_complex(complex_, normals, CUT_SETTINGS[1]))
    eulers = tuple(surface_eulers(complex_, cut) for cut in cuts)
    return _Trial(points, normals, local, complex_, cuts, eulers, sum(1 - cut.coverage for cut in cuts))


def _moved(
    points: Floats, normals: Floats, local: LocalGeometry, shift: Floats | float
) -> tuple[Floats, LocalGeometry, DelaunayComplex]:
    """The samples after a shift, with their neighborhoods and tetrahedra."""
    there = points + (shift * local.spacings)[:, None] * normals
    around = local_geometry(there)
    return there, around, delaunay_complex(there, around.spacings)


def _shifts(points: Floats, normals: Floats, local: LocalGeometry) -> Iterator[Floats | float]:
    """Shifts outward in spacings: of all samples alike, and of each (N,) to the side that has more room."""
    behind, ahead = clearances(points, normals, local)
    toward_room = np.clip(ahead - behind, -1, 1)
    near = local.wide_index[:, :_SMOOTHED_OVER]
    for _ in range(2):
        toward_room = (toward_room + toward_room[near].sum(1)) / (1 + _SMOOTHED_OVER)
    outward = 1.0 if (behind < _NEAR).sum() >= (ahead < _NEAR).sum() else -1.0
    for length in _SHIFTS:
        yield outward * length
        yield length * toward_room


def clearances(points: Floats, normals: Floats, local: LocalGeometry) -> tuple[Floats, Floats]:
    """Thickness of the wall behind each sample and width of the gap in front of it, (N,), in spacings, at most 3.

    Args:
        points: (N, 3).
        normals: (N, 3), unit, outward.
        local: neighborhoods of the points, among which the opposite sheet is looked for.
    """
    index = local.wide_index
    opposite, height, side = opposite_neighbors(points, normals, index)
    back = ((points[:, None] - points[index]) * normals[index]).sum(2)  # the height, seen from the other sample
    aside = np.sqrt(np.maximum(side, 0))
    distance = np.hypot(height, np.maximum(aside - _SIDEWAYS * local.spacings[:, None], 0)) / local.spacings[:, None]
    walls, gaps = opposite & (height < 0) & (back < 0), opposite & (height > 0) & (back > 0)
    behind, ahead = (np.where(facing, distance, _FREE).min(1) for facing in (walls, gaps))
    return np.minimum(behind, _FREE), np.minimum(ahead, _FREE)
