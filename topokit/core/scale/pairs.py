"""Persistent homology of a signed distance: when classes appear and disappear as a solid grows, and where."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.persistence import cubical_pairs
from topokit.core.scale.signed_distance import SignedDistance


@dataclass(frozen=True, eq=False)
class PersistentPairs:
    """Classes of the homology of the points whose signed distance is at most r, for all r.

    Attributes:
        dimension: (M,), 0 to 2.
        birth: (M,), signed distance at which each class appears.
        death: (M,), at which it disappears; infinite for one of dimension 0.
        born: (M, 3), vertices of the grid at which they appear.
        dead: (M, 3), at which they disappear; where they appear for those that do not.
    """

    dimension: Integers
    birth: Floats
    death: Floats
    born: Floats
    dead: Floats

    def chosen(self, rule: Callable[[Floats, Floats], Booleans]) -> PersistentPairs:
        """The pairs of which a rule for births and deaths holds."""
        rows = rule(self.birth, self.death)
        return PersistentPairs(
            self.dimension[rows], self.birth[rows], self.death[rows], self.born[rows], self.dead[rows]
        )


def persistent_pairs(distance: SignedDistance) -> PersistentPairs:
    """The pairs of a signed distance; voxels of the solid are connected across corners, too.

    Raises:
        MissingDependencyError: if cripser is not installed.
    """
    if not (distance.values < 0).any():
        nothing = np.empty((0, 3))
        return PersistentPairs(np.empty(0, dtype=np.int64), np.empty(0), np.empty(0), nothing, nothing)
    pairs = cubical_pairs(distance.values, "T")
    dead = np.where(np.isinf(pairs[:, 2:3]), pairs[:, 3:6], pairs[:, 6:9])
    return PersistentPairs(pairs[:, 0].astype(np.int64), pairs[:, 1], pairs[:, 2], pairs[:, 3:6], dead)
