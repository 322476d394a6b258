"""The cells of two solids and their union on one grid, each labeled by the solids that it belongs to.

Conventions are those of `grid.euler`. In connectivity 26 a solid is a union of closed cubes and a cell belongs to it if
any voxel around it does; in connectivity 6 voxels are vertices and a cell belongs to it if all of its vertices do. So
a cell may belong to the union of two 6-connected solids and to neither of them.

A cell is one byte: two bits of rank, three for the axes along which it extends, and its state. Cells that touch are
next to each other in an array of twice the resolution.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Booleans

Cells = NDArray[np.uint8]

BOTH, FIRST, SECOND, UNION = range(4)
"""Ranks: the cell belongs to both solids, to one of them, or to their union only. Lower ranks form subcomplexes."""

EXTENT = 4
"""The bit of axis 0; those of axes 1 and 2 follow."""

PRESENT, CRITICAL, UPPER = 32, 64, 128
"""States; the last two are given by `reduction`."""

_IN_FIRST, _IN_SECOND, _IN_UNION = 1, 2, 4


def labeled_cells(first: Booleans, second: Booleans, connectivity: int) -> Cells:
    """The cells (2X + 3, 2Y + 3, 2Z + 3) of two solids, with a layer of absent cells (0) all round.

    Args:
        first: (X, Y, Z), whether a voxel is in the first solid.
        second: (X, Y, Z), whether it is in the second.
        connectivity: 6 or 26, that of the solids.
    """
    joined = np.bitwise_and if connectivity == 6 else np.bitwise_or
    cells = np.zeros([2 * n + 3 for n in first.shape], np.uint8)
    voxels = cells[2:-1:2, 2:-1:2, 2:-1:2]
    voxels |= first.view(np.uint8) * np.uint8(_IN_FIRST | _IN_UNION)
    voxels |= second.view(np.uint8) * np.uint8(_IN_SECOND | _IN_UNION)
    for axis in range(3):
        along = np.moveaxis(cells, axis, 0)
        joined(along[:-2:2], along[2::2], out=along[1::2])
    ranks = np.zeros(8, np.uint8)
    for bits, rank in ((7, BOTH), (5, FIRST), (6, SECOND), (4, UNION)):
        ranks[bits] = PRESENT | rank
    extends_if_odd = int(connectivity == 6)
    for odd in product((0, 1), repeat=3):
        part = cells[tuple(slice(start, None, 2) for start in odd)]
        extents = sum(EXTENT << axis for axis in range(3) if odd[axis] == extends_if_odd)
        part[:] = np.where(ranks, ranks | np.uint8(extents), 0).astype(np.uint8)[part]
    return cells
