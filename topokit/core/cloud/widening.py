"""Samples moved along their normals, so that thin walls and narrow gaps are as wide as the samples can resolve.

Where two sheets are closer than the sample spacing, tetrahedra join the wrong ones. A shift outward thickens the wall
between them, a shift inward widens the gap, and neither changes the topology as long as the way is free. Several shifts
compete. All samples lie on the surface, so that shift is the best whose cuts leave the fewest of them off it. This
needs normals that are known: wrong ones would move the sheets through each other.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from topokit.core.cloud.delaunay_cut import DelaunayComplex, cut_complex, delaunay_complex
from topokit.core.cloud.neighborhoods import LocalGeometry, local_geometry, opposite_neighbors
from topokit.core.cloud.votes import CUT_SETTINGS

Floats = NDArray[np.float64]

_SHIFTS = (0.3, 0.6)  # in spacings; a wall without thickness needs about one spacing to be resolved
_FREE = 3.0  # spacings beyond which another sheet does not matter
_NEAR = 1.5  # spacings up to which it may be joined to the wrong side
_SIDEWAYS = 0.7  # spacings by which the opposite sample of a sheet may lie aside
_SMOOTHED_OVER = 8  # neighbors over which the shifts are averaged, twice


def widened(points: Floats, normals: Floats, local: LocalGeometry, complex_: DelaunayComplex) -> Floats | None:
    """Shifted positions (N, 3) whose cuts leave fewer samples off the surface, or None if no shift does.

    Args:
        points: (N, 3).
        normals: (N, 3), unit, outward, and known.
        local: neighborhoods of the points.
        complex_: tetrahedra of the points.
    """
    best, fewest = None, _missed(complex_, normals)
    for shift in _shifts(points, normals, local):
        moved = points + (shift * local.spacings)[:, None] * normals
        missed = _missed(delaunay_complex(moved, local_geometry(moved).spacings), normals)
        if missed < fewest:
            best, fewest = moved, missed
    return best


def _missed(complex_: DelaunayComplex, normals: Floats) -> float:
    """Share of the samples off the surface of a cut, summed over two settings."""
    return sum(1 - cut_complex(complex_, normals, weights).coverage for weights in CUT_SETTINGS[:2])


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
