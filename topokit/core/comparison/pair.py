"""Two solids on one grid and what is counted of both."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from topokit.core.arrays import Booleans
from topokit.core.blocks.division import Triple
from topokit.core.comparison.regions import MatchedRegions, matched_cavities, matched_parts
from topokit.core.comparison.tunnels import TunnelComplex, TunnelRanks
from topokit.core.grid.euler import check_connectivity


@dataclass(frozen=True)
class MatchedNumbers:
    """Betti numbers of two solids and of what they have in common: parts, tunnels and cavities.

    Attributes:
        first, second: of the solids.
        matched: dimension of im H_k(first) ∩ im H_k(second) in H_k of the union, k = 0, 1, 2, over GF(2).
    """

    first: Triple
    second: Triple
    matched: Triple


class SolidPair:
    """Two solids on one grid; everything is found when it is first needed.

    Attributes:
        first, second: (x, y, z), whether a voxel is in them, in the smallest box that holds both.
        corner: index of the first voxel of that box in the grid.
        connectivity: 6 or 26, theirs.
    """

    def __init__(self, first: Booleans, second: Booleans, connectivity: int) -> None:
        """Args: first, second (X, Y, Z); connectivity 6 or 26."""
        self.connectivity = check_connectivity(connectivity)
        along = [np.flatnonzero((first | second).any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
        box = tuple(slice(layers[0], layers[-1] + 1) if len(layers) else slice(0, 0) for layers in along)
        self.corner: Triple = (int(box[0].start), int(box[1].start), int(box[2].start))
        self.first, self.second = np.ascontiguousarray(first[box]), np.ascontiguousarray(second[box])

    @cached_property
    def parts(self) -> MatchedRegions:
        """Their parts."""
        return matched_parts((self.first, self.second), self.connectivity)

    @cached_property
    def cavities(self) -> MatchedRegions:
        """Their cavities."""
        return matched_cavities((self.first, self.second), self.connectivity)

    @cached_property
    def complex(self) -> TunnelComplex:
        """Their critical cells."""
        return TunnelComplex(self.first, self.second, self.connectivity)

    @cached_property
    def tunnels(self) -> TunnelRanks:
        """Their tunnels."""
        return self.complex.ranks()

    @cached_property
    def numbers(self) -> MatchedNumbers:
        """All Betti numbers."""
        found = self.parts, self.tunnels, self.cavities
        first, second = ((found[0].betti[side], found[1].betti[side], found[2].betti[side]) for side in (0, 1))
        return MatchedNumbers(first, second, (found[0].matched, found[1].matched, found[2].matched))
