"""Which tunnels two solids on one grid have in common: ranks of maps between first homology groups."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.comparison.cells import FIRST, SECOND, UNION, labeled_cells
from topokit.core.comparison.gf2 import Span, from_bits, kernel
from topokit.core.comparison.reduction import reduced, sides_of


@dataclass(frozen=True)
class TunnelRanks:
    """Ranks of the maps from H₁ of two solids to H₁ of their union, with coefficients in GF(2).

    Attributes:
        betti: of both solids.
        surviving: for each solid, the rank of its map: tunnels that the other solid does not fill.
        together: the rank of both maps together.
    """

    betti: tuple[int, int]
    surviving: tuple[int, int]
    together: int

    @property
    def matched(self) -> int:
        """Dimension of the intersection of both images."""
        return sum(self.surviving) - self.together


class TunnelComplex:
    """The critical cells of two solids, with cycles and boundaries as vectors over the critical edges."""

    def __init__(self, first: Booleans, second: Booleans, connectivity: int) -> None:
        cells = labeled_cells(first, second, connectivity)
        self.shape, self.reduction = cells.shape, reduced(cells)
        dimensions, ranks = self.reduction.dimensions, self.reduction.ranks
        self._edges, self._squares = (np.flatnonzero(dimensions == k) for k in (1, 2))
        self._edge_ranks, self._square_ranks = ranks[self._edges], ranks[self._squares]

    @cached_property
    def _columns(self) -> list[int]:
        """The boundary of each critical square."""
        known = self.reduction
        squares = known.critical[self._squares].tolist()
        return [self.class_of(sides_of(known.cells, known.steps, square)) for square in squares]

    @cached_property
    def _numbers(self) -> dict[int, int]:
        """The bit of each critical edge, by its row."""
        return {int(row): bit for bit, row in enumerate(self._edges)}

    def class_of(self, edges: Integers) -> int:
        """Edges that form a cycle as a vector over the critical edges."""
        return from_bits(self._numbers[row] for row in self.reduction.slid(edges))

    @property
    def n_edges(self) -> int:
        """Critical edges: coordinates of the vectors."""
        return len(self._edges)

    @property
    def edge_rows(self) -> Integers:
        """(n_edges,) their rows in the reduction."""
        return self._edges

    def boundaries(self, solid: int) -> Span:
        """The boundaries in a solid, `FIRST` or `SECOND`, or in their `UNION`."""
        own = _belongs(self._square_ranks, solid)
        return Span(column for column, is_own in zip(self._columns, own, strict=True) if is_own)

    def cycles(self, solid: int) -> list[int]:
        """A basis of the cycles in a solid."""
        own = np.flatnonzero(_belongs(self._edge_ranks, solid)).tolist()
        ends = self.reduction.ends(self._edges[own]).tolist()
        return kernel([1 << one ^ 1 << other for one, other in ends], [1 << bit for bit in own])

    def positions(self, vertices: Integers) -> Floats:
        """Vertices (N,), flat indices of cells, as (N, 3) in steps of the grid from the center of its first voxel."""
        return np.stack(np.unravel_index(vertices, self.shape), axis=1) / 2 - 1

    def ranks(self) -> TunnelRanks:
        """What the solids have in common."""
        filled, betti, surviving = self.boundaries(UNION), [], []
        together = filled.copy()
        for solid in (FIRST, SECOND):
            cycles, image = self.cycles(solid), filled.copy()
            betti.append(len(cycles) - len(self.boundaries(solid)))
            surviving.append(sum(image.add(cycle) for cycle in cycles))
            for cycle in cycles:
                together.add(cycle)
        return TunnelRanks((betti[0], betti[1]), (surviving[0], surviving[1]), len(together) - len(filled))


def _belongs(ranks: Integers, solid: int) -> Booleans:
    return (ranks == 0) | (ranks == solid) if solid != UNION else np.ones(len(ranks), bool)
