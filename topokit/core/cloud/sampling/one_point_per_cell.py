"""One point for each cell of a grid: a summary of any number of points, and summaries merge exactly.

The cells are cubes whose side is a power of two, aligned to the origin, so no box has to be known before. Of the
points in a cell that is kept whose coordinates are mixed to the smallest number, a random one. Where more cells hold
points than a budget allows, the next coarser grid is used. Numbers of points, smallest numbers and the finest grid
within the budget do not depend on how points are split or in which order their summaries are joined, and nothing is
rounded. So neither does the result, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.sampling.copies import distinct
from topokit.core.labels import count_distinct

Keys = NDArray[np.uint64]

FINEST = -500
"""Exponent of cells so small that each holds one position."""

_COARSEST = 520  # of cells that hold all numbers whose squares are finite, but for their signs
_WINDOW = float(1 << 20)  # cells along each axis that have a key by their place; those outside are numbered one by one
_FAR = np.uint64(1 << 63)
_DIRECTIONS = np.uint64(6)  # that a normal may have: of two sheets in one cell a point each is kept
_LOOKED_AT = 10_000  # points by which the middle and a first guess are found
_ROWS = 1 << 13  # points whose keys are made at once: 64 KiB stay in the cache, and under what Dask lets workers keep
_FACTORS = (
    *(0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9),
    *(0xD6E8FEB86659FD93, 0xA0761D6478BD642F, 0xFF51AFD7ED558CCD),
)


@dataclass(frozen=True, eq=False)
class Cells:
    """The points that were kept, one for each of C cells.

    Attributes:
        exponent: the side of the cells is 2 to this power.
        points: (C, 3), of the points that were seen one for each cell.
        normals: (C, 3), theirs, or None.
        count: (C,), how many points were seen in each cell.
    """

    exponent: int
    points: Floats
    normals: Floats | None
    count: Integers

    @classmethod
    def of(cls, points: Floats, normals: Floats | None = None) -> Cells:
        """Every point as a cell of its own: what summaries are made from, by `joined`.

        Args:
            points: (N, 3), finite, and so near that squares are finite, too.
            normals: (N, 3), finite; where they point in different directions, points share no cell.
        """
        return cls(FINEST, points, normals, np.ones(len(points), dtype=np.int64))

    @property
    def side(self) -> float:
        """Length of the sides of the cells."""
        return float(2.0**self.exponent)

    def at(self, rows: NDArray[np.bool_] | Integers) -> Cells:
        """Some of the cells."""
        normals = None if self.normals is None else self.normals[rows]
        return replace(self, points=self.points[rows], normals=normals, count=self.count[rows])

    def sorted(self) -> Cells:
        """The same cells in the order of the coordinates of their points."""
        return self.at(np.lexsort(self.points.T))


def joined(parts: Sequence[Cells], most: int) -> Cells:
    """One summary of all points that were seen by several.

    Args:
        parts: with normals, or without; at least one.
        most: largest number of cells; where more hold points, the cells are made larger.
    """
    normals = [part.normals for part in parts if part.normals is not None]
    whole = Cells(
        max(part.exponent for part in parts),
        _without_negative_zeros(np.concatenate([part.points for part in parts])),
        _without_negative_zeros(np.concatenate(normals)) if normals else None,
        np.concatenate([part.count for part in parts]),
    )
    return _one_per_cell(replace(whole, exponent=_exponent(whole, most)))


def _without_negative_zeros(values: Floats) -> Floats:
    values += 0.0  # in place: −0 becomes 0, which mixes to one number
    return values


def _one_per_cell(cells: Cells) -> Cells:
    """Of all points with one key that with the smallest number; two with one number are the same."""
    if len(cells.points) == 0:
        return cells
    order, ordered = in_order(cell_keys(cells.points, cells.normals, cells.exponent))
    is_first = np.append(True, ordered[1:] != ordered[:-1])
    first = np.flatnonzero(is_first)
    number = mixed(cells)[order]
    group = np.cumsum(is_first) - 1
    smallest = np.flatnonzero(number == np.minimum.reduceat(number, first)[group])
    smallest = smallest[np.append(True, np.diff(group[smallest]) > 0)]
    return replace(cells.at(order[smallest]), count=np.add.reduceat(cells.count[order], first))


def in_order(keys: Keys) -> tuple[Integers, Keys]:
    """What sorts the keys, and the sorted keys; short ones with their rows, which is several times faster."""
    n_bits = len(keys).bit_length()
    if int(keys.max()).bit_length() + n_bits > 64:
        order = np.argsort(keys)
        return order, keys[order]
    both = np.sort((keys << np.uint64(n_bits)) | np.arange(len(keys), dtype=np.uint64))
    return (both & np.uint64((1 << n_bits) - 1)).view(np.int64), both >> np.uint64(n_bits)


def cell_keys(points: Floats, normals: Floats | None, exponent: int) -> Keys:
    """Numbers (N,) that are equal where points (N, 3) lie in one cell and their normals point in one direction."""
    low, high = (places(np.array([[pick(column) for column in points.T]]), exponent)[:, 0] for pick in (np.min, np.max))
    if (high - low >= _WINDOW).any():
        middle = np.median(places(points[:: 1 + len(points) // _LOOKED_AT], exponent), axis=1)
        low = np.maximum(low, np.floor(middle) - _WINDOW / 2)
        high = np.minimum(high, low + _WINDOW - 1)
    keys, is_near = np.empty(len(points), dtype=np.uint64), np.empty(len(points), dtype=bool)
    for start in range(0, len(points), _ROWS):
        rows = slice(start, start + _ROWS)
        keys[rows], is_near[rows] = packed(places(points[rows], exponent), low, high)
    direction = None if normals is None else _directions(normals)
    if direction is not None:
        keys = keys * _DIRECTIONS + direction
    far = np.flatnonzero(~is_near)
    if len(far):
        number = distinct(np.ascontiguousarray(places(points[far], exponent).T))[1].astype(np.uint64)
        keys[far] = _FAR + (number if direction is None else number * _DIRECTIONS + direction[far])
    return keys


def places(points: Floats, exponent: int) -> Floats:
    """The cells (3, N) of points (N, 3) by whole numbers, which floating point holds whatever their size."""
    return np.floor(points.T * 2.0**-exponent)


def packed(place: Floats, low: Floats, high: Floats) -> tuple[Keys, NDArray[np.bool_]]:
    """Cells (3, N) in a box, from its lowest (3,) to its highest one (3,), as one number each; and which are in it."""
    keys, is_inside = np.zeros(place.shape[1], dtype=np.uint64), np.ones(place.shape[1], dtype=bool)
    for row, first, last in zip(place, low, high, strict=True):
        outside = (row < first) | (row > last)
        offset = row - first
        if outside.any():
            is_inside &= ~outside
            offset[outside] = 0
        keys = keys * np.uint64(last - first + 1) + offset.astype(np.int64).view(np.uint64)
    return keys, is_inside


def _directions(normals: Floats) -> Keys:
    """Which of six directions each normal (N, 3) has: the axis along which it is longest, and its sign there."""
    axis = np.abs(normals).argmax(1)
    is_up = np.take_along_axis(normals, axis[:, None], 1)[:, 0] > 0
    return (2 * axis + is_up).astype(np.uint64)


def mixed(cells: Cells, series: int = 0) -> Keys:
    """Numbers (C,), one for each point, that follow from its coordinates and normal and look random; several series."""
    found = np.empty(len(cells.points), dtype=np.uint64)
    for start in range(0, len(found), _ROWS):
        rows = slice(start, start + _ROWS)
        columns = [*cells.points[rows].T, *(() if cells.normals is None else cells.normals[rows].T)]
        number = np.full(len(columns[0]), series, dtype=np.uint64)
        for column, factor in zip(columns, _FACTORS, strict=False):
            number = (number ^ np.ascontiguousarray(column).view(np.uint64)) * np.uint64(factor)
            number ^= number >> np.uint64(32)
        found[rows] = number
    return found


def _exponent(cells: Cells, most: int) -> int:
    """The exponent of the cells, or of the smallest larger ones of which at most so many hold points."""
    if len(cells.points) <= most:
        return cells.exponent

    @lru_cache
    def fits(exponent: int) -> bool:
        return count_distinct(cell_keys(cells.points, cells.normals, exponent).view(np.int64)) <= most

    if cells.exponent > FINEST:  # of a running summary: seldom more than one step
        return next((one for one in range(cells.exponent, _COARSEST) if fits(one)), _COARSEST)
    some = cells.points[:: 1 + len(cells.points) // _LOOKED_AT]
    extent = float(np.ptp(np.quantile(some, (0.05, 0.95), axis=0), axis=0).max())
    guess = int(np.floor(np.log2(max(extent, 2.0**FINEST) / most**0.5)))
    return _smallest(fits, max(guess, FINEST))


def _smallest(fits: Callable[[int], bool], guess: int) -> int:
    """The smallest exponent that fits, if all above one do; looked for in growing steps from a guess."""
    step, too_fine, fitting = 1, guess, guess
    if fits(guess):
        while too_fine >= FINEST and fits(too_fine):
            fitting, too_fine, step = too_fine, too_fine - step, 2 * step
        too_fine = max(too_fine, FINEST - 1)
    else:
        while fitting < _COARSEST and not fits(fitting):
            too_fine, fitting, step = fitting, min(fitting + step, _COARSEST), 2 * step
    while fitting - too_fine > 1:
        middle = (fitting + too_fine) // 2
        too_fine, fitting = (too_fine, middle) if fits(middle) else (middle, fitting)
    return fitting
