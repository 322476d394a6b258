"""An integer from a field that can only be looked at point by point: finer grids until the counts agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from topokit.core.coarse_to_fine import Evaluate, FieldGrid, refine
from topokit.core.grid_euler import solid_euler


@dataclass(frozen=True)
class GridCount:
    """χ of the surface of a solid on one grid.

    Attributes:
        n_cells: cells along the grid's longest axis.
        step: the largest step between grid points, in units of length.
        euler_26, euler_6: χ of the surface with either connectivity.
    """

    n_cells: int
    step: float
    euler_26: int
    euler_6: int

    @property
    def agrees(self) -> bool:
        """Whether both connectivities give one integer: the grid resolves what it sees."""
        return self.euler_26 == self.euler_6

    def __str__(self) -> str:
        values = f"{self.euler_26}" if self.agrees else f"{self.euler_26} or {self.euler_6} (26- or 6-connected)"
        return f"{values} on {self.n_cells} cells"


@dataclass(frozen=True)
class SettledCount:
    """What grids of growing fineness said.

    Attributes:
        counts: one per grid, coarsest first.
        euler: the integer that was seen most often in either connectivity, the coarsest grid aside; of several
            the one seen on the finest grid.
        is_settled: whether the last two grids agree with each other and in both connectivities.
        grid: the coarsest grid that shows `euler` in both connectivities, else the finest that may be kept.
        n_evaluations: points at which the field was evaluated.
        n_points: points of the finest grid.
    """

    counts: tuple[GridCount, ...]
    euler: int
    is_settled: bool
    grid: FieldGrid
    n_evaluations: int
    n_points: int

    @property
    def self_consistent_values(self) -> set[int]:
        """Integers on which both connectivities agreed on some grid."""
        return {count.euler_26 for count in self.counts if count.agrees}


_KEPT_CELLS = 256  # grids beyond this are counted, not kept: labels of their components would take gigabytes
_SUCCESSIVE = 3  # grids in a row that must agree; with two, 3 of 58 trained networks were believed in vain


def settle(grid: FieldGrid, evaluate: Evaluate, finest: int, advance: Callable[[int, int], None]) -> SettledCount:
    """Count χ on grids of twice, four times, ... the cells.

    The counts are settled when both connectivities agree on one integer on three grids in a row (or on all, where
    there are fewer but at least two), and no coarser grid was of one mind about another integer. No grid proves
    anything about what lies between its points.

    Args:
        grid: the coarsest grid.
        evaluate: the field, as for `refine`.
        finest: no grid gets more cells than this along its longest axis.
        advance: told (cells of the grid done, cells of the last one) after each grid.
    """
    counts: list[GridCount] = []
    kept: dict[int, FieldGrid] = {}
    for one in _grids(grid, evaluate, finest):
        grid = one
        counts.append(GridCount(one.n_cells, one.step, *(2 * int(solid_euler(one.values, 0.0, c)) for c in (26, 6))))
        if one.n_cells <= _KEPT_CELLS or not kept:
            kept[len(counts) - 1] = one
        advance(one.n_cells, finest)
    euler = _most_frequent(counts)
    agreeing = [i for i in kept if counts[i].agrees and counts[i].euler_26 == euler]
    last = counts[-_SUCCESSIVE:]
    settled = len(last) > 1 and all(count.agrees and count.euler_26 == euler for count in last)
    found = SettledCount(
        tuple(counts), euler, settled, kept[agreeing[0] if agreeing else max(kept)], grid.n_evaluations,
        grid.values.numel(),
    )
    if len(found.self_consistent_values) > 1:
        return replace(found, is_settled=False)
    return found


def _grids(grid: FieldGrid, evaluate: Evaluate, finest: int) -> Iterator[FieldGrid]:
    yield grid
    while 2 * grid.n_cells <= finest:
        grid = refine(grid, evaluate)
        yield grid


def _most_frequent(counts: list[GridCount]) -> int:
    """The integer seen most often, of several the one seen on the finest grid; the coarsest grid has no vote."""
    votes = [value for count in counts[1:] or counts for value in (count.euler_26, count.euler_6)]
    tally = Counter(votes)
    return max(reversed(votes), key=lambda value: tally[value])
