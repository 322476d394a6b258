"""Euler characteristic and Betti numbers of a field on a grid at all its levels, exact, in one pass and a union-find.

As the level falls, voxels enter the solid one after the other. How χ changes there is the critical index of
`grid.euler`. A voxel without neighbors in the solid begins a component; one whose neighbors do not touch each other
around it joins components, unless they are joined elsewhere, which a union-find forest knows. The same with the
background, as the level rises, gives the cavities; tunnels are β₁ = β₀ + β₂ − χ. Only voxels that may join something
are sorted: few in smooth fields.

References:
    Conventions and the curve of χ: see `grid.euler`. Union-find over critical points only: H. Carr, J. Snoeyink,
    U. Axen, "Computing contour trees in all dimensions", 2003, doi:10.1016/S0925-7721(02)00093-7.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from topokit.core.arrays import Floats, Integers
from topokit.core.blocks.links import (
    BITS_OF_SOLID,
    IS_BIRTH,
    IS_SADDLE,
    classify,
    count_merges,
    entered_before,
    link_layer,
)
from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, check_connectivity
from topokit.errors import InputError

_MOST_DIRECT = 1 << 16  # whole numbers in a range up to here are tallied in a table
_MOST_VOXELS = np.iinfo(np.int32).max - 1
_PLACES = 1 << 16  # masks whose class is kept at hand
_TYPES = ("u1", "i4", "i8", "f4", "f8")  # for which loops are compiled


@dataclass(frozen=True, eq=False)
class EulerCurve:
    """χ and Betti numbers of solids over a level t, such as {field > t}.

    Attributes:
        levels: (n,), ascending. The numbers of row i hold for levels[i] ≤ t < levels[i + 1].
        euler: (n,) χ of the solid, half of that of its surface.
        betti: (n, 3) pieces, tunnels and cavities.
        lowest: χ and Betti numbers at levels below the first one; (4,).
        over: what the levels are.
    """

    levels: Floats
    euler: Integers
    betti: Integers
    lowest: Integers
    over: str = "level"

    def at(self, levels: ArrayLike) -> EulerCurve:
        """The curve at other levels, ascending; its rows hold there, and perhaps no further.

        Raises:
            InputError: if the levels are no ascending row of numbers.
        """
        wanted = np.asarray(levels, dtype=float)
        if wanted.ndim != 1 or not (np.diff(wanted) > 0).all() or np.isnan(wanted).any():
            raise InputError(f"levels must be an ascending row of numbers, got {levels!r}.")
        rows = np.concatenate((self.lowest[None], np.column_stack((self.euler, self.betti))))
        found = rows[np.searchsorted(self.levels, wanted, side="right")]
        return EulerCurve(wanted, found[:, 0], found[:, 1:], self.lowest, self.over)

    def sampled(self, most: int) -> EulerCurve:
        """The curve at so many evenly spaced levels, or itself if it has no more."""
        if len(self.levels) <= most:
            return self
        finite = self.levels[np.isfinite(self.levels)]
        return self.at(np.linspace(finite[0], finite[-1], most))

    def range_of(self, level: float) -> tuple[float, float]:
        """The levels around a level at which all numbers are the same: from the first value up to the second.

        They are −∞ or ∞ where nothing changes any more.
        """
        row = int(np.searchsorted(self.levels, level, side="right"))
        ends = np.concatenate(([-np.inf], self.levels, [np.inf]))
        return float(ends[row]), float(ends[row + 1])

    def to_dict(self) -> dict[str, Any]:
        """What the levels are; levels, χ and Betti numbers as lists, ready for JSON."""
        numbers = {"levels": self.levels.tolist(), "euler": self.euler.tolist(), "betti": self.betti.tolist()}
        return {"over": self.over} | numbers


def euler_curve(field: Tensor | ArrayLike, connectivity: int = DEFAULT_CONNECTIVITY) -> EulerCurve:
    """χ and Betti numbers of {field > t} for every t, exact. Runs on the CPU, in 5 to 9 bytes a voxel beside the field.

    Args:
        field: (X, Y, Z) of any real type. NaN counts as background.
        connectivity: 6 or 26, that of the solid.

    Returns:
        The curve at all levels at which a number changes.

    Raises:
        InputError: if the field has other axes or more than 2³¹ voxels, or the connectivity is neither 6 nor 26.

    Example:
        >>> import numpy as np
        >>> ring = np.ones((3, 3, 1))
        >>> ring[1, 1] = 0.2
        >>> curve = euler_curve(ring)
        >>> curve.levels.tolist(), curve.betti.tolist()
        ([0.2, 1.0], [[1, 1, 0], [0, 0, 0]])
    """
    values = _comparable(field)
    if values.ndim != 3 or not 0 < values.size <= _MOST_VOXELS:
        raise InputError(f"a curve needs a field (X, Y, Z) with at most 2³¹ voxels, got {values.shape}.")
    solid_is_six = check_connectivity(connectivity) == 6
    tally, phases = _Tally(values), (_Phase(values, solid_is_six, False), _Phase(values, not solid_is_six, True))
    masks, classes = np.empty(values.shape[1:], np.int32), np.empty(values.shape[1:], np.int32)
    known, results = np.full(_PLACES, -1, np.int32), np.empty(_PLACES, np.int32)
    for x, layer in enumerate(values):
        entered_before(values, x, masks)
        classify(masks, solid_is_six, known, results, classes)
        for phase in phases:
            phase.add(x, masks, classes)
        where = np.flatnonzero(classes >> 2 * BITS_OF_SOLID)
        tally.add(0, layer.reshape(-1)[where], classes.reshape(-1)[where] >> 2 * BITS_OF_SOLID)
    for column, phase in enumerate(phases, start=1):
        voxels, changes = phase.changes()
        tally.add(column, values.reshape(-1)[voxels], -changes if phase.of_background else changes)
    return tally.curve()


class _Phase:
    """The solid or the background: where regions begin and where they may join."""

    def __init__(self, values: NDArray[Any], is_six: bool, of_background: bool) -> None:
        self._values, self._is_six, self.of_background = values, is_six, of_background
        self._parents = np.empty(values.size + 1, np.int32)
        self._parents[-1] = values.size
        self._births: list[Integers] = []
        self._saddles: list[Integers] = []
        self._masks: list[NDArray[np.int32]] = []

    def add(self, x: int, masks: NDArray[np.int32], classes: NDArray[np.int32]) -> None:
        """Take the next layer."""
        link_layer(classes, x, len(self._values), self.of_background, self._parents)
        found = classes.reshape(-1) >> (BITS_OF_SOLID if self.of_background else 0) & (IS_BIRTH | IS_SADDLE)
        where = np.flatnonzero(found)
        births, saddles = where[found[where] == IS_BIRTH], where[found[where] == IS_SADDLE]
        self._births.append(births + x * masks.size)
        self._saddles.append(saddles + x * masks.size)
        self._masks.append(masks.reshape(-1)[saddles])

    def changes(self) -> tuple[Integers, Integers]:
        """The voxels at which the number of regions changes as they come into the phase, and by how much."""
        births, saddles, masks = (
            np.concatenate(self._births),
            np.concatenate(self._saddles),
            np.concatenate(self._masks),
        )
        rising = len(saddles) - 1 - np.argsort(self._values.reshape(-1)[saddles[::-1]], kind="stable")
        order = rising if self.of_background else rising[::-1]
        voxels, merges = saddles[order], np.zeros(len(saddles), np.int8)
        count_merges(voxels, masks[order], self._values.shape, self._is_six, self.of_background, self._parents, merges)
        return np.concatenate((births, voxels)), np.concatenate((np.ones(len(births), np.int64), -merges))


class _Tally:
    """Changes of χ, β₀ and β₂ as voxels enter the solid, by their values."""

    def __init__(self, values: NDArray[Any]) -> None:
        is_whole = values.dtype.kind != "f"
        self._low, high = (int(values.min()), int(values.max())) if is_whole else (0, _MOST_DIRECT)
        self._table = np.zeros((high - self._low + 1, 3), np.int64) if high - self._low < _MOST_DIRECT else None
        self._found: tuple[list[tuple[NDArray[Any], NDArray[Any]]], ...] = ([], [], [])

    def add(self, column: int, values: NDArray[Any], changes: NDArray[Any]) -> None:
        """Add changes at voxels with these values."""
        if self._table is None:
            self._found[column].append((values, changes.astype(np.int8)))
        else:
            place = values.astype(np.int64) - self._low
            self._table[:, column] += np.bincount(place, changes, len(self._table)).astype(np.int64)

    def curve(self) -> EulerCurve:
        """The sums over voxels above each level, at those levels at which one changes."""
        levels, sums = self._listed() if self._table is None else self._tabulated(self._table)
        euler, pieces, cavities = np.concatenate((sums, np.zeros((1, 3), np.int64))).T  # row i holds below levels[i]
        rows = np.column_stack((euler, pieces, pieces + cavities - euler, cavities))
        kept = np.append((rows[1:] != rows[:-1]).any(axis=1) & (levels > -np.inf), True)  # −∞ and NaN are in no solid
        levels, rows = levels[kept[:-1]].astype(float), rows[kept]
        return EulerCurve(levels, rows[1:, 0], rows[1:, 1:], rows[0])

    def _tabulated(self, table: Integers) -> tuple[Integers, Integers]:
        return np.arange(len(table)) + self._low, np.cumsum(table[::-1], axis=0)[::-1]

    def _listed(self) -> tuple[NDArray[Any], Integers]:
        columns = [map(np.concatenate, zip(*found, strict=True)) for found in self._found]
        pairs = [(values, changes) for values, changes in columns]
        levels = np.unique(np.concatenate([values for values, _ in pairs]))
        sums = np.zeros((len(levels), 3), np.int64)
        for column, (values, changes) in enumerate(pairs):
            order = np.argsort(values)
            above = np.append(np.cumsum(changes[order][::-1], dtype=np.int64)[::-1], 0)
            sums[:, column] = above[np.searchsorted(values[order], levels)]
        return levels, sums


def _comparable(field: Tensor | ArrayLike) -> NDArray[Any]:
    """The values, contiguous, in one of the types for which loops are compiled; NaN becomes −∞."""
    if isinstance(field, Tensor):
        field = (
            (field.float() if field.dtype.itemsize == 2 and field.is_floating_point() else field).detach().cpu().numpy()
        )
    values = np.asarray(field)
    values = values.view(np.uint8) if values.dtype == bool else values
    if values.dtype == np.uint64 and values.max(initial=0) <= np.iinfo(np.int64).max:
        values = values.astype(np.int64)
    wider = [one for one in _TYPES if np.can_cast(values.dtype, one, "safe") and values.dtype != np.uint64]
    if not wider:
        raise InputError(f"a curve needs real numbers, got {values.dtype}: convert them to int64 or float64.")
    values = np.ascontiguousarray(values, dtype=wider[0])
    has_nan = values.dtype.kind == "f" and np.isnan(values).any()
    return np.where(np.isnan(values), -np.inf, values).astype(values.dtype) if has_nan else values
