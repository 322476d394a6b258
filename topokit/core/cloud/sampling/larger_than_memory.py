"""A cloud of any size as so few of its points that they can be looked at: those of `Cells`, thinned where few lie.

One point for each cell makes densely and thinly scanned places alike. It also makes the rare points far from a noisy
surface as frequent as those near it, and each stray point as important as a piece of surface. So within each
neighborhood points are left out until the others are as frequent as they were.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.cloud.sampling.cube_hierarchy import moments, thickness_of
from topokit.core.cloud.sampling.one_point_per_cell import FINEST, Cells, cell_keys, in_order, mixed

_STRAY_LEVELS = 2  # cubes of 4 × 4 × 4 cells that may be no surface
_RARE = 32  # times fewer points than in the cube of most points, of a cube that may be haze
_SHEET = 8  # cells that hold points, at least, of a cube that shows a thinly scanned surface
_FLAT = 0.15  # thickness over side of such a cube, at most
_DENSITY_LEVELS = 4  # cubes of 16 × 16 × 16 cells in which the density is kept
_FULL = 0.9  # quantile of the numbers of points in the cells of a cube from which their points are kept for certain


@dataclass(frozen=True, eq=False)
class ReducedCloud:
    """What is left of a cloud.

    Attributes:
        points: (M, 3), some of its points.
        normals: (M, 3), theirs, or None.
        side: of the cells of which one point was kept at most; 0 if every position was kept.
        n_stray: points left out as haze: far fewer than elsewhere, and on no sheet.
    """

    points: Floats
    normals: Floats | None
    side: float
    n_stray: int


def reduced(cells: Cells) -> ReducedCloud:
    """What is left of the points that a summary has seen."""
    cells = cells.sorted()
    if cells.exponent == FINEST:
        return ReducedCloud(cells.points, cells.normals, 0.0, 0)
    is_stray = _strays(cells)
    kept = cells.at(~is_stray)
    kept = kept.at(_as_dense_as_before(kept))
    return ReducedCloud(kept.points, kept.normals, cells.side, int(cells.count[is_stray].sum()))


def _strays(cells: Cells) -> Booleans:
    """Which cells (C,) lie in a cube with far fewer points than others, which show no surface either."""
    order, first, cube = _cubes(cells, _STRAY_LEVELS)
    n_points, n_cells = np.add.reduceat(cells.count[order], first), np.diff(np.append(first, len(order)))
    ordered = np.sort(n_points)
    typical = ordered[np.searchsorted(np.cumsum(ordered), n_points.sum() / 2)]  # of the cube of a point, not of a cube
    points = cells.points[order]
    points -= (np.add.reduceat(points, first, axis=0) / n_cells[:, None])[cube]
    thickness = thickness_of(moments(points, np.ones(len(points)), first))
    is_sheet = (n_cells >= _SHEET) & (thickness < _FLAT * cells.side * 2**_STRAY_LEVELS)
    found = np.empty(len(order), dtype=bool)
    found[order] = ((n_points < typical / _RARE) & ~is_sheet)[cube]
    return found


def _as_dense_as_before(cells: Cells) -> Booleans:
    """Which cells (C,) are kept: at random, in proportion to their points, but all of the fullest of each cube."""
    order, first, cube = _cubes(cells, _DENSITY_LEVELS)
    order = order[np.lexsort((cells.count[order], cube))]
    n_cells = np.diff(np.append(first, len(order)))
    full = cells.count[order[first + np.floor(_FULL * (n_cells - 1)).astype(np.int64)]][cube]
    found = np.empty(len(order), dtype=bool)
    found[order] = mixed(cells.at(order), 1) * 2.0**-64 * full < cells.count[order]
    return found


def _cubes(cells: Cells, levels: int) -> tuple[Integers, Integers, Integers]:
    """The order of the cells (C,) by larger cubes, the first of each cube in that order, and the cube of each (C,)."""
    order, keys = in_order(cell_keys(cells.points, None, cells.exponent + levels))
    is_first = np.append(True, keys[1:] != keys[:-1])
    return order, np.flatnonzero(is_first), np.cumsum(is_first) - 1
