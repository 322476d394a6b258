"""Which boxes hold which points, in time that follows the number of answers rather than points times boxes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Floats, Integers

Hashes = NDArray[np.uint64]

_LEVELS = 20  # sizes of boxes that are distinguished, each half the one before; what is smaller counts as the smallest
_PAIRS = 1 << 21  # candidate pairs held at once
_MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)  # 2⁶⁴ divided by the golden ratio, odd


def boxes_around(
    points: Floats, low: Floats, high: Floats, point_groups: Integers, box_groups: Integers
) -> Iterator[tuple[Integers, Integers]]:
    """Pairs of a point and a box of the same group that holds it.

    Boxes of similar size are put into a grid whose cells are at least as large, so that each touches at most 2ᵈ cells,
    and a point looks into its own cell of every such grid.

    Args:
        points: (P, d).
        low: (B, d) lowest corners of the boxes, which belong to them.
        high: (B, d) highest corners, which do as well.
        point_groups: (P,) only boxes of the same group are tested.
        box_groups: (B,)

    Yields:
        Indices of points and of boxes, in pieces of bounded size.
    """
    if len(low) == 0:
        return
    origin, top = low.min(axis=0), high.max(axis=0)
    near = np.flatnonzero(((origin <= points) & (points <= top)).all(axis=1))
    smallest = np.ldexp((top - origin).max(), -_LEVELS)
    levels = np.frexp(np.maximum((high - low).max(axis=1), smallest))[1]
    for level in np.unique(levels):
        boxes = np.flatnonzero(levels == level)
        keys, of_key = _occupied_cells(low[boxes] - origin, high[boxes] - origin, box_groups[boxes], level)
        own = row_hashes(_cells(points[near] - origin, level), point_groups[near])
        begin, end = np.searchsorted(keys, own), np.searchsorted(keys, own, side="right")
        for row, entry in _ranges(begin, end):
            point, box = near[row], boxes[of_key[entry]]
            is_around = ((low[box] <= points[point]) & (points[point] <= high[box])).all(axis=1)
            is_around &= point_groups[point] == box_groups[box]
            yield point[is_around], box[is_around]


def row_hashes(rows: Integers | Hashes, start: Integers) -> Hashes:
    """A 64-bit hash of every row of whole numbers (N, m), mixed into what there is (N,)."""
    mixed = start.astype(np.uint64)
    for column in rows.view(np.uint64).T:
        mixed = (mixed ^ column) * _MULTIPLIER
        mixed ^= mixed >> np.uint64(32)
    return mixed


def _cells(places: Floats, level: int) -> Integers:
    return np.floor(np.ldexp(places, -level)).astype(np.int64)


def _occupied_cells(low: Floats, high: Floats, groups: Integers, level: int) -> tuple[Hashes, Integers]:
    """Sorted hashes of the cells that boxes touch, and the box of each; no box is larger than a cell."""
    first, last = _cells(low, level), _cells(high, level)
    keys, owners = [], []
    for step in product((0, 1), repeat=low.shape[1]):
        touches = np.flatnonzero((first + step <= last).all(axis=1))
        keys.append(row_hashes(first[touches] + step, groups[touches]))
        owners.append(touches)
    all_keys = np.concatenate(keys)
    order = np.argsort(all_keys)
    return all_keys[order], np.concatenate(owners)[order]


def _ranges(begin: Integers, end: Integers) -> Iterator[tuple[Integers, Integers]]:
    """The pairs (i, j) with begin[i] ≤ j < end[i], in pieces of bounded size (at least one i each)."""
    some = np.flatnonzero(end > begin)
    counts = (end - begin)[some]
    reached = np.cumsum(counts)
    start = 0
    while start < len(some):
        before = reached[start] - counts[start]
        stop = max(start + 1, int(np.searchsorted(reached, before + _PAIRS, side="right")))
        rows, sizes = some[start:stop], counts[start:stop]
        within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        yield np.repeat(rows, sizes), np.repeat(begin[rows], sizes) + within
        start = stop
