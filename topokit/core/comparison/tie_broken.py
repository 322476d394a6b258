"""Betti matching of two solids as its official program counts it, ties of the filtration broken by positions of cells.

Betti matching pairs the bars of two solids through those of their union U. In a solid all cells come at once, and so
do those outside, so what it pairs depends on the order of cells outside U, which is that of their corners. They end the
classes of H_k(U) one by one. A feature counts as matched if a class that comes from the first solid and one that comes
from the second are ended by the same cell. So the count is at least the dimension of the intersection of both images,
which is what `pair` counts, and it is no invariant: turned volumes have another order.

References:
    N. Stucki et al., "Topologically faithful image segmentation via induced matching of persistence barcodes", ICML
    2023, arXiv:2211.15272. N. Stucki et al., "Efficient Betti matching enables topology-aware 3D segmentation via
    persistent homology", 2024, arXiv:2407.04683 (the program, whose order this is).
"""

from __future__ import annotations

from itertools import product

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.persistence import cubical_pairs

_OWN, _IN_UNION, _OUTSIDE = 0.0, 1.0, 2.0  # values of cells; those outside are numbered from the last one on


def betti_matched(first: Booleans, second: Booleans) -> tuple[int, int, int]:
    """Parts, tunnels and cavities that Betti matching counts as matched, the part that never ends among them.

    Solids are 6-connected. The numbers of the official program are these, less 1 part if both solids are there: it
    leaves out the part that never ends.

    Args:
        first: (X, Y, Z), whether a voxel is in the first solid.
        second: likewise; of the whole grid, since all cells outside count.

    Raises:
        MissingDependencyError: if cripser is not installed.
    """
    order, union = _order_of_cells(first.shape), _cells(first | second)
    ends = [_ends(_cells(solid), union, order) for solid in (first, second)]
    x, y, z = (len(np.intersect1d(ends[0][k], ends[1][k])) for k in range(3))
    return x, y, z


def _cells(solid: Booleans) -> Booleans:
    """(2X − 1, …) whether a cell is in a solid: all of its vertices are. Cells that touch are next to each other."""
    cells = np.zeros([2 * n - 1 for n in solid.shape], bool)
    cells[::2, ::2, ::2] = solid
    for axis in range(3):
        along = np.moveaxis(cells, axis, 0)
        np.logical_and(along[:-2:2], along[2::2], out=along[1::2])
    return cells


def _order_of_cells(shape: tuple[int, ...]) -> Floats:
    """(2X − 1, …) values of cells outside: by dimension, by lowest corner, by direction of an edge or of a normal."""
    order = np.empty([2 * n - 1 for n in shape])
    corners = 3 * np.arange(np.prod(shape), dtype=np.float64).reshape(shape)
    for odd in product((0, 1), repeat=3):
        dimension = sum(odd)
        direction = {1: odd.index(1) if 1 in odd else 0, 2: odd.index(0) if 0 in odd else 0}.get(dimension, 0)
        low = corners[tuple(slice(0, n - one) for n, one in zip(shape, odd, strict=True))]
        order[tuple(slice(one, None, 2) for one in odd)] = low + (_OUTSIDE + direction + dimension * 3 * corners.size)
    return order


def _ends(own: Booleans, union: Booleans, order: Floats) -> list[Integers]:
    """By dimension the values of the cells that end a class of the union which comes from a solid."""
    pairs = cubical_pairs(np.where(own, _OWN, np.where(union, _IN_UNION, order)), "V")
    lasting = pairs[(pairs[:, 1] == _OWN) & (pairs[:, 2] > _IN_UNION)]
    return [lasting[lasting[:, 0] == k, 2] for k in range(3)]
