"""An integer from a field that can only be looked at point by point: finer grids until the counts agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from torch import Tensor

from topokit.core.grid.euler import solid_euler
from topokit.core.grid.field import median_step_at_crossings
from topokit.core.implicit.adaptive_grid import Evaluate, FieldGrid, refine


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
        is_settled: whether that integer may be believed, see `settle`.
        moved: the integers that the last two grids show with the level moved to and fro by a twentieth and a tenth of
            the field's typical change over one of their cells.
        faces: for each axis, whether the solid reaches the lower and the upper face of the box.
        grid: the coarsest grid that shows `euler` in both connectivities, else the finest that may be kept.
        n_evaluations: points at which the field was evaluated.
        n_points: points of the finest grid.
    """

    counts: tuple[GridCount, ...]
    euler: int
    is_settled: bool
    moved: tuple[int, ...]
    faces: tuple[tuple[bool, bool], ...]
    grid: FieldGrid
    n_evaluations: int
    n_points: int


_KEPT_CELLS = 256  # grids beyond this are counted, not kept: labels of their components would take gigabytes
_SUCCESSIVE = 3  # grids in a row that must agree
_SHIFTS = (-0.1, -0.05, 0.05, 0.1)  # shares of the field's change over one cell by which the level is moved


def settle(
    grid: FieldGrid, evaluate: Evaluate, finest: int, advance: Callable[[FieldGrid], None] = lambda grid: None
) -> SettledCount:
    """Count χ on grids of twice, four times, ... the cells.

    The count is settled when both connectivities agree on one integer on the last three grids (or on all of them, where
    there are only two), no coarser grid was of one mind about another integer, and moving the level by a twentieth or a
    tenth of the field's change over one cell changes nothing on the last two grids. Two agreeing grids alone are not
    enough: see docs/paper-shapes.md for trained networks whose topology depends on the grid. Still no grid proves
    anything about what lies between its points.

    Args:
        grid: the coarsest grid.
        evaluate: the field, as for `refine`.
        finest: no grid gets more cells than this along its longest axis.
        advance: told about each grid once it is evaluated.
    """
    counts: list[GridCount] = []
    kept: list[FieldGrid] = []
    before: tuple[int, ...] = ()
    for one in _grids(grid, evaluate, finest):
        grid = one
        counts.append(GridCount(one.n_cells, one.step, *_both(one, 0.0)))
        if one.n_cells <= _KEPT_CELLS or not kept:
            kept.append(one)
        if finest // 4 < one.n_cells <= finest // 2:
            before = _moved(one)
        advance(one)
    euler = _most_frequent(counts)
    moved = (*before, *_moved(grid))
    last = counts[-_SUCCESSIVE:]
    agreed = {count.euler_26 for count in counts if count.agrees}
    settled = len(last) > 1 and all(count.agrees for count in last) and agreed == {euler} == set(moved)
    showing = [one for one, count in zip(kept, counts, strict=False) if count.agrees and count.euler_26 == euler]
    return SettledCount(
        counts=tuple(counts),
        euler=euler,
        is_settled=settled,
        moved=moved,
        faces=reached_faces(grid.values),
        grid=showing[0] if showing else kept[-1],
        n_evaluations=grid.n_evaluations,
        n_points=grid.values.numel(),
    )


def reached_faces(values: Tensor) -> tuple[tuple[bool, bool], ...]:
    """For each axis, whether the solid reaches the first and the last layer of the grid (X, Y, Z)."""

    def reached(axis: int, end: int) -> bool:
        return bool((values.select(axis, end) > 0).any())

    return tuple((reached(axis, 0), reached(axis, -1)) for axis in range(3))


def _moved(grid: FieldGrid) -> tuple[int, ...]:
    change = median_step_at_crossings(grid.values)
    return tuple(value for shift in _SHIFTS for value in _both(grid, shift * change))


def _both(grid: FieldGrid, level: float) -> tuple[int, int]:
    return 2 * int(solid_euler(grid.values, level, 26)), 2 * int(solid_euler(grid.values, level, 6))


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
