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

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from topokit.core.arrays import Floats, Integers
from topokit.core.blocks.links import (
    BITS_OF_SOLID,
    IS_BIRTH,
    IS_EVENT,
    classify,
    count_merges,
    entered_before,
    link_layer,
    sum_changes,
)
from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, check_connectivity
from topokit.errors import InputError

MOST_RANKS = 1 << 16  # whole numbers in a range up to here are tallied in a table
_MOST_VOXELS = np.iinfo(np.int32).max - 1
_PLACES = 1 << 16  # masks whose class is kept at hand
_TYPES = ("u1", "i4", "i8", "f4", "f8")  # for which loops are compiled


@dataclass(frozen=True, eq=False)
class EulerCurve:
    """χ and Betti numbers of solids over a level t, such as {field > t}.

    Attributes:
        levels: (n,), ascending. The numbers of row i hold for levels[i] ≤ t < levels[i + 1].
        euler: (n,) χ of the solid, half of that of its surface.
        betti: (n, 3) pieces, tunnels and cavities; (n, 0) if χ alone was asked.
        lowest: χ and Betti numbers at levels below the first one; (4,) or (1,).
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
        wanted = as_levels(levels)
        rows = np.concatenate((self.lowest[None], np.column_stack((self.euler, self.betti))))
        found = rows[np.searchsorted(self.levels, wanted, side="right")]
        return EulerCurve(wanted, found[:, 0], found[:, 1:], self.lowest, self.over)

    def sampled(self, most: int) -> EulerCurve:
        """The curve at no more of its levels than that, spaced as evenly as they allow."""
        finite = np.flatnonzero(np.isfinite(self.levels))
        if len(self.levels) <= most or not len(finite):
            return self
        wanted = np.linspace(self.levels[finite[0]], self.levels[finite[-1]], most)
        rows = np.unique(np.searchsorted(self.levels, wanted, side="right") - 1)
        return EulerCurve(self.levels[rows], self.euler[rows], self.betti[rows], self.lowest, self.over)

    def without_betti(self) -> EulerCurve:
        """χ alone, at the same levels."""
        return replace(self, betti=self.betti[:, :0], lowest=self.lowest[:1])

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


def as_levels(levels: ArrayLike) -> Floats:
    """Levels as an array.

    Raises:
        InputError: if they are no ascending row of numbers.
    """
    wanted = np.asarray(levels, dtype=float)
    if wanted.ndim != 1 or not (np.diff(wanted) > 0).all() or np.isnan(wanted).any():
        raise InputError(f"levels must be an ascending row of numbers, got {levels!r}.")
    return wanted


def euler_curve(field: Tensor | ArrayLike, connectivity: int = DEFAULT_CONNECTIVITY, betti: bool = True) -> EulerCurve:
    """χ and Betti numbers of {field > t} for every t, exact. Runs on the CPU, in 5 to 9 bytes a voxel beside the field.

    Args:
        field: (X, Y, Z) of any real type. NaN counts as background.
        connectivity: 6 or 26, that of the solid.
        betti: whether to count Betti numbers, too; χ alone needs no joining of regions.

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
    is_whole = values.dtype.kind != "f"
    tally = Tally(int(values.min()), int(values.max())) if is_whole else Tally(0, MOST_RANKS)
    solid_is_six = check_connectivity(connectivity) == 6
    if not betti:
        tally_euler(values, solid_is_six, 0, tally, 1)
        return tally.curve().without_betti()
    tally_changes(values, solid_is_six, 0, tally)
    return tally.curve()


def tally_changes(
    values: NDArray[Any], solid_is_six: bool, open_faces: int, tally: Tally
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Add all changes in a volume to a tally, as far as they do not depend on what is beyond its open faces.

    Args:
        values: (X, Y, Z), contiguous, of a type for which loops are compiled, without NaN.
        solid_is_six: whether the solid is 6-connected; else the background is.
        open_faces: see `links`.
        tally: of the volume.

    Returns:
        For the solid and for the background: (L, 3) indices of two voxels at open faces that are joined, and of a third
        one, with whose value they are. The index after the last one is the outside.
    """
    phases = [_Phase(values, solid_is_six, open_faces, False), _Phase(values, not solid_is_six, open_faces, True)]
    for x, masks, classes in _layers(values, solid_is_six, open_faces):
        for phase in phases:
            phase.add(x, masks, classes)
        _tally_euler(values[x], classes, tally, 1)
    links = []
    for column, phase in enumerate(phases, start=1):
        voxels, changes, found = phase.changes()
        tally.add(column, values.reshape(-1)[voxels], -changes if phase.of_background else changes)
        links.append(found)
    return links[0], links[1]


def tally_euler(values: NDArray[Any], solid_is_six: bool, open_faces: int, tally: Tally, sign: int) -> None:
    """Add the changes of χ alone, or take them away; arguments are those of `tally_changes`."""
    for x, _, classes in _layers(values, solid_is_six, open_faces):
        _tally_euler(values[x], classes, tally, sign)


def _tally_euler(layer: NDArray[Any], classes: NDArray[np.int32], tally: Tally, sign: int) -> None:
    where = np.flatnonzero(classes >> 2 * BITS_OF_SOLID)
    tally.add(0, layer.reshape(-1)[where], sign * (classes.reshape(-1)[where] >> 2 * BITS_OF_SOLID))


def _layers(
    values: NDArray[Any], solid_is_six: bool, open_faces: int
) -> Iterator[tuple[int, NDArray[np.int32], NDArray[np.int32]]]:
    """The number of each layer, the masks of its voxels and their classes, which are overwritten by the next ones."""
    masks, classes = np.empty(values.shape[1:], np.int32), np.empty(values.shape[1:], np.int32)
    known = np.full(_PLACES, -1, np.int64)
    for x in range(len(values)):
        entered_before(values, x, masks)
        classify(masks, x, values.shape, open_faces, solid_is_six, known, classes)
        yield x, masks, classes


class _Phase:
    """The solid or the background: where regions begin and where they may join."""

    def __init__(self, values: NDArray[Any], is_six: bool, open_faces: int, of_background: bool) -> None:
        self._values, self._is_six, self._open_faces, self.of_background = values, is_six, open_faces, of_background
        self._parents = np.empty(values.size + 1, np.int32)
        self._parents[-1] = values.size
        self._births: list[Integers] = []
        self._events: list[Integers] = []
        self._masks: list[NDArray[np.int32]] = []

    def add(self, x: int, masks: NDArray[np.int32], classes: NDArray[np.int32]) -> None:
        """Take the next layer."""
        link_layer(classes, x, self._values.shape, self._open_faces, self.of_background, self._parents)
        found = classes.reshape(-1) >> (BITS_OF_SOLID if self.of_background else 0) & (IS_BIRTH | IS_EVENT)
        where = np.flatnonzero(found)
        births, events = where[found[where] & IS_BIRTH > 0], where[found[where] & IS_EVENT > 0]
        self._births.append(births + x * masks.size)
        self._events.append(events + x * masks.size)
        self._masks.append(masks.reshape(-1)[events])

    def changes(self) -> tuple[Integers, Integers, NDArray[np.int32]]:
        """The voxels at which the number of regions changes as they come into the phase, by how much, and links."""
        births, events, masks = (
            np.concatenate(self._births),
            np.concatenate(self._events),
            np.concatenate(self._masks),
        )
        rising = len(events) - 1 - _stable_order(self._values.reshape(-1)[events[::-1]])
        order = rising if self.of_background else rising[::-1]
        voxels, merges = events[order], np.zeros(len(events), np.int8)
        links = np.empty((len(events) if self._open_faces else 0, 3), np.int32)
        n_links = count_merges(
            *(voxels, masks[order], self._values.shape, self._open_faces, self._is_six, self.of_background),
            *(self._parents, links, merges),
        )
        links = links[:n_links]
        links[:, 2] = voxels[links[:, 2]]
        return np.concatenate((births, voxels)), np.concatenate((np.ones(len(births), np.int64), -merges)), links


class Tally:
    """Changes of χ, β₀ and β₂ as voxels enter the solid, by their values."""

    def __init__(self, low: int, high: int) -> None:
        """Args: bounds of the values; so far apart that there is no table for them if they are no whole numbers."""
        self._low = low
        self.table = np.zeros((high - low + 1, 3), np.int64) if high - low < MOST_RANKS else None
        self._found: tuple[list[tuple[NDArray[Any], NDArray[Any]]], ...] = ([], [], [])

    def __add__(self, other: Tally) -> Tally:
        """The changes of both, whose values have the same bounds and are in tables."""
        if self.table is None or other.table is None:
            raise AssertionError("a list of changes is to be added to another one")
        found = Tally(self._low, self._low + len(self.table) - 1)
        found.table = self.table + other.table
        return found

    def add(self, column: int, values: NDArray[Any], changes: NDArray[Any]) -> None:
        """Add changes at voxels with these values."""
        if self.table is None:
            self._found[column].append((values, changes.astype(np.int8)))
        else:
            place = values.astype(np.int64) - self._low
            self.table[:, column] += np.bincount(place, changes, len(self.table)).astype(np.int64)

    def curve(self) -> EulerCurve:
        """The sums over voxels above each level, at those levels at which one changes."""
        values, columns, changes = self._listed() if self.table is None else self._tabulated(self.table)
        n_levels = 1 + int(np.count_nonzero(values[1:] != values[:-1]))
        levels, rows = np.empty(n_levels), np.empty((n_levels + 1, 4), np.int64)
        n_levels = sum_changes(values, columns, changes, levels, rows)
        levels, rows = levels[:n_levels][::-1], rows[: n_levels + 1][::-1]  # row i holds below level i
        return EulerCurve(levels, rows[1:, 0], rows[1:, 1:], rows[0])

    def _tabulated(self, table: Integers) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        values = np.repeat(np.arange(len(table)) + self._low, 3)
        return values, np.tile(np.arange(3, dtype=np.int8), len(table)), table.ravel()

    def _listed(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        values, changes = (np.concatenate([one[part] for found in self._found for one in found]) for part in range(2))
        counts = [sum(len(found_values) for found_values, _ in found) for found in self._found]
        columns, order = np.repeat(np.arange(3, dtype=np.int8), counts), _stable_order(values)
        return values[order], columns[order], changes[order]


def _stable_order(values: NDArray[Any]) -> Integers:
    """The order of values without NaN, equal ones as they come. Words of 64 bits sort fast, so 32 hold the index."""
    if values.dtype.itemsize != 4:
        return np.argsort(values, kind="stable")
    bits = (values + values.dtype.type(0)).view(np.int32)  # −0 becomes 0
    if values.dtype.kind == "f":
        bits ^= bits >> 31 & np.iinfo(np.int32).max  # negative numbers ascend as their bits descend
    keys = (bits.astype(np.int64) << 32) + np.arange(len(bits))
    keys.sort()
    return keys & np.iinfo(np.uint32).max


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
