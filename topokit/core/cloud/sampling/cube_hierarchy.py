"""A hierarchy of cubes over points: what each cube holds, and the cells that a budget of samples allows.

A cube is split while the points in it bend. Where normals are known, the two sheets of a thin wall are told apart, so
that a wall is as cheap as a plane: what counts is how far each sheet by itself is from flat. A cube that holds a part
that bends is itself one that bends, so no small feature is missed because most of its cube is a plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Floats, Integers

_BITS = 20  # levels of the hierarchy; three times as many bits make one key
_FEWEST = 4  # points that a plane is fitted to, and from which a cube may be split if there are plenty
_PLENTY = 8  # points per cell of the largest budget from which smaller cubes are never needed
_NOISE_FACTOR = 2.0  # thickness below so many times the noise counts as flat
_BASE_SHARE = 0.25  # share of the cells that is spent on cubes of equal size
_EVEN = 1e-6  # priority of flat cubes, per relative side: what is left of the budget is spread evenly


@dataclass(frozen=True, eq=False)
class _Level:
    """The C cubes of one level that hold points and whose parent may be split.

    `first` and `last` (excluded) delimit each cube's points along the curve; `parent` is an index into the level above;
    `bend` is the thickness over the side; `axis` the component of the normals that tells two sheets apart; `sheets` is
    1 or 2.
    """

    first: Integers
    last: Integers
    parent: Integers
    bend: Floats
    axis: Integers
    sheets: Integers


def curve_order(points: Floats) -> tuple[Integers, NDArray[np.uint64]]:
    """Order of points (N, 3) along a Z-order curve through their box, and the keys in that order.

    Reference:
        G. M. Morton, "A computer oriented geodetic data base and a new technique in file sequencing", IBM, 1966.
    """
    low = points.min(0)
    extent = float((points.max(0) - low).max()) or 1.0  # all in one place
    cell = ((points - low) * (2**_BITS * (1 - 1e-12) / extent)).astype(np.uint64)
    key = _spread_bits(cell[:, 0]) | _spread_bits(cell[:, 1]) << np.uint64(1) | _spread_bits(cell[:, 2]) << np.uint64(2)
    order = np.argsort(key, kind="stable")
    return order, key[order]


def _spread_bits(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Put two zero bits between each two of the lowest 21 bits."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        values = (values | values << np.uint64(shift)) & np.uint64(mask)
    return values


class CubeHierarchy:
    """Cubes over N points down to those with few points, each with its bend."""

    def __init__(
        self, points: Floats, normals: Floats | None = None, *, largest: int, noise: float = 0.0, thickness: bool = True
    ) -> None:
        """Sort the points and measure the cubes; linear in their number.

        Args:
            points: (N, 3), not all in one place.
            normals: (N, 3), unit. If given, opposite sheets in a cube are measured, and sampled, apart.
            largest: the largest budget that `cells` will be asked for.
            noise: standard deviation of the points from the surface; cubes no thicker than twice that are flat.
            thickness: whether the bend is the thickness of the points over the side; else that of their axes alone.
        """
        self.order, self._key = curve_order(points)
        self._points = points[self.order]
        self._normals = None if normals is None else normals[self.order]
        self._by_sheet = normals is not None and thickness
        self._extent = float(np.ptp(points, axis=0).max())
        self._noise, self._thickness = noise, thickness
        self._fewest = _FEWEST if len(points) >= _PLENTY * largest else 2
        self._base_depth = self._base(int(_BASE_SHARE * largest))
        self._levels = self._measure()
        self._priority = self._inherited()

    def cells(self, budget: int) -> Integers:
        """The cell 0 … c−1 of every point, (N,), c ≤ budget, in the order of the points given.

        Cubes are split in the order of their bend until the budget is used.
        """
        is_split = self._split(budget)
        labels = np.empty(len(self.order), dtype=np.int64)
        reached = np.ones(len(self._levels[0].first), dtype=bool)
        n_cells = 0
        for depth, level in enumerate(self._levels):
            split = reached & is_split[depth]
            leaf = reached & ~split
            rows, cube = _rows(level.first[leaf], level.last[leaf])
            labels[rows] = n_cells + 2 * cube + self._sheet(rows, level.axis[leaf][cube])
            n_cells += 2 * int(leaf.sum())
            if depth + 1 < len(self._levels):
                reached = split[self._levels[depth + 1].parent]
        used = np.zeros(n_cells, dtype=bool)
        used[labels] = True
        found = np.empty_like(labels)
        found[self.order] = (np.cumsum(used) - 1)[labels]
        return found

    def _base(self, most: int) -> int:
        """The deepest level with at most so many cubes that hold points."""
        depth = 0
        while depth < _BITS and 1 + int(np.count_nonzero(np.diff(self._prefix(depth + 1)))) <= most:
            depth += 1
        return depth

    def _prefix(self, depth: int) -> NDArray[np.uint64]:
        return self._key >> np.uint64(3 * (_BITS - depth))

    def _measure(self) -> list[_Level]:
        starts = np.flatnonzero(np.diff(self._prefix(self._base_depth), prepend=np.uint64(2**63)))
        first, last = starts, np.append(starts[1:], len(self.order))
        parent = np.zeros(len(first), dtype=np.int64)
        levels = []
        for depth in range(self._base_depth, _BITS + 1):
            levels.append(self._level(first, last, parent, self._extent / 2**depth))
            divided = np.flatnonzero(last - first >= self._fewest)
            if len(divided) == 0 or depth == _BITS:
                break
            rows, cube = _rows(first[divided], last[divided])
            prefix = self._key[rows] >> np.uint64(3 * (_BITS - depth - 1))
            starts = np.flatnonzero((np.diff(prefix, prepend=np.uint64(2**63)) != 0) | (np.diff(cube, prepend=-1) != 0))
            first, parent = rows[starts], divided[cube[starts]]
            last = first + np.diff(np.append(starts, len(rows)))
        return levels

    def _level(self, first: Integers, last: Integers, parent: Integers, side: float) -> _Level:
        rows, cube = _rows(first, last)
        offset = np.cumsum(last - first) - (last - first)
        count = (last - first).astype(np.float64)
        axis, sheets = np.zeros(len(first), dtype=np.int64), np.ones(len(first), dtype=np.int64)
        if not self._thickness:
            return _Level(first, last, parent, self._turn(rows, offset, count), axis, sheets)
        points = self._points[rows]
        points -= (np.add.reduceat(points, offset, axis=0) / count[:, None])[cube]
        whole = moments(points, np.ones(len(rows)), offset)
        if self._normals is None or not self._by_sheet:
            thickness = thickness_of(whole)
        else:
            normals = self._normals[rows]
            axis = np.add.reduceat(normals * normals, offset, axis=0).argmax(1)
            front = self._sheet(rows, axis[cube])
            one = moments(points, front.astype(np.float64), offset)
            other = whole - one
            thickness = np.maximum(thickness_of(one), thickness_of(other))
            sheets = (one[:, 0] > 0).astype(np.int64) + (other[:, 0] > 0)
        thickness[thickness <= _NOISE_FACTOR * self._noise] = 0
        return _Level(first, last, parent, thickness / side + _EVEN * side / self._extent, axis, sheets)

    def _turn(self, rows: Integers, offset: Integers, count: Floats) -> Floats:
        """How much the axes in each cube differ: √(1 − λ) of the mean n nᵀ with its largest eigenvalue λ."""
        assert self._normals is not None
        normals = self._normals[rows]
        moments = [np.add.reduceat(normals[:, a] * normals[:, b], offset) / count for a in range(3) for b in range(3)]
        largest = np.linalg.eigvalsh(np.stack(moments, 1).reshape(-1, 3, 3))[:, 2]
        return np.sqrt(np.maximum(1 - largest, 0)) + _EVEN * count / len(self.order)

    def _sheet(self, rows: Integers, axis: Integers) -> Integers:
        """0 or 1: on which of two opposite sheets a point lies, by the sign of one component of its normal."""
        if self._normals is None or not self._by_sheet:
            return np.zeros(len(rows), dtype=np.int64)
        return (self._normals[rows, axis] > 0).astype(np.int64)

    def _inherited(self) -> list[Floats]:
        """The largest bend in each cube and all cubes within; −1 for cubes that are not split."""
        found = [level.bend.copy() for level in self._levels]
        for depth in range(len(found) - 1, 0, -1):
            np.maximum.at(found[depth - 1], self._levels[depth].parent, found[depth])
        for depth, level in enumerate(self._levels):
            is_last = depth == len(self._levels) - 1
            found[depth][(level.last - level.first < self._fewest) | is_last] = -1
        return found

    def _split(self, budget: int) -> list[NDArray[np.bool_]]:
        """Which cubes of each level are split, so that at most `budget` cells result; equal bends in mixed order."""
        sizes = [len(level.first) for level in self._levels]
        gain = np.zeros(sum(sizes), dtype=np.int64)
        for depth, (start, below) in enumerate(zip(np.cumsum([0, *sizes]), self._levels[1:], strict=False)):
            children = np.bincount(below.parent, below.sheets, sizes[depth]).astype(np.int64)
            gain[start : start + sizes[depth]] = children - self._levels[depth].sheets
        priority = np.concatenate(self._priority)
        depths = np.repeat(np.arange(len(sizes)), sizes)
        mixed = np.arange(len(priority), dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        order = np.lexsort((mixed, depths, -priority))
        order = order[priority[order] >= 0]
        total = int(self._levels[0].sheets.sum()) + np.maximum.accumulate(np.cumsum(gain[order]))
        split = np.zeros(len(priority), dtype=bool)
        split[order[: np.searchsorted(total, budget, side="right")]] = True
        return np.split(split, np.cumsum(sizes)[:-1])


def _rows(first: Integers, last: Integers) -> tuple[Integers, Integers]:
    """The rows of all cubes, concatenated, and the cube that each belongs to."""
    count = last - first
    cube = np.repeat(np.arange(len(first)), count)
    return np.arange(len(cube)) + (first - (np.cumsum(count) - count))[cube], cube


def moments(points: Floats, weight: Floats, offset: Integers) -> Floats:
    """Sums of w, w x, and w x xᵀ over consecutive rows, (C, 10)."""
    columns = [weight] + [weight * points[:, a] for a in range(3)]
    columns += [columns[1 + a] * points[:, b] for a in range(3) for b in range(a, 3)]
    return np.stack([np.add.reduceat(column, offset) for column in columns], axis=1)


def thickness_of(sums: Floats) -> Floats:
    """Root-mean-square distance from the best plane, (C,); zero for fewer than four points."""
    count = np.maximum(sums[:, 0], 1)[:, None]
    mean = sums[:, 1:4] / count
    covariance = np.empty((len(sums), 3, 3))
    pairs = [(a, b) for a in range(3) for b in range(a, 3)]
    for column, (a, b) in enumerate(pairs, start=4):
        covariance[:, a, b] = covariance[:, b, a] = sums[:, column] / count[:, 0] - mean[:, a] * mean[:, b]
    thickness = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, 0], 0))
    return np.where(sums[:, 0] >= _FEWEST, thickness, 0.0)
