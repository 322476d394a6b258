"""The levels of a curve as whole numbers: the rank of a gray value is how many levels are below it.

A voxel is in the solid {field > t} of the level with number j exactly if its rank is above j. So ranks have the same
curve at these levels, however many different values there are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from topokit.core.arrays import Floats
from topokit.core.blocks.curve import MOST_RANKS, EulerCurve, as_levels
from topokit.errors import InputError


@dataclass(frozen=True, eq=False)
class GrayLevels:
    """The levels of a curve.

    Attributes:
        first: the lowest value, if all whole numbers from there on are levels.
        given: otherwise the levels, ascending, with −∞ before them.
        n_ranks: how many ranks there are.
    """

    first: int
    given: Floats
    n_ranks: int

    @classmethod
    def all_of(cls, dtype: DTypeLike) -> GrayLevels | None:
        """All levels of the values of a type; None if they are too many."""
        kind = np.dtype(dtype)
        if kind.kind not in "iub" or kind.itemsize > 2:
            return None
        bounds = (0, 1) if kind.kind == "b" else (np.iinfo(kind).min, np.iinfo(kind).max)
        return cls(int(bounds[0]), np.empty(0), int(bounds[1] - bounds[0]) + 1)

    @classmethod
    def at(cls, levels: ArrayLike) -> GrayLevels:
        """These levels.

        Raises:
            InputError: if they are not ascending, or too many.
        """
        given = as_levels(levels)
        if len(given) > MOST_RANKS - 2:
            raise InputError(f"a curve has at most {MOST_RANKS - 2} levels here, got {len(given)}.")
        return cls(0, np.concatenate(([-np.inf], given)), len(given) + 2)

    def ranks(self, values: NDArray[Any]) -> NDArray[Any]:
        """The ranks of values (X, Y, Z), uint8 or int32. NaN has rank 0."""
        kind = np.uint8 if self.n_ranks <= 1 << 8 else np.int32
        found = np.empty(values.shape, kind)
        if not len(self.given):
            np.subtract(values, self.first, out=found, dtype=np.int32, casting="unsafe")
            return found
        for layer, values_of_layer in zip(found, values, strict=True):
            wide = values_of_layer.astype(float)
            layer[:] = np.searchsorted(self.given, np.where(np.isnan(wide), -np.inf, wide))
        return found

    def curve(self, of_ranks: EulerCurve) -> EulerCurve:
        """The curve over the levels, given that over ranks."""
        if not len(self.given):
            return replace(of_ranks, levels=of_ranks.levels + self.first)
        found = of_ranks.at(np.arange(len(self.given)))
        lowest = np.concatenate((found.euler[:1], found.betti[0]))
        return EulerCurve(self.given[1:], found.euler[1:], found.betti[1:], lowest)
