"""Grid convergence study: χ of a level set on finer and finer grids, until the counts agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from topokit.core.grid.euler import surface_euler
from topokit.core.grid.grid import Grid
from topokit.core.grid.tau import typical_step
from topokit.core.implicit.adaptive_grid import NONE, AdaptiveField, Evaluate, refine_grid
from topokit.core.implicit.blockwise import ONE_BY_ONE, Blocks, Refinements, next_grid
from topokit.core.implicit.box_counts import ReachedFaces, rounded, value_of
from topokit.core.implicit.unseen_parts import count_unseen, lone_vertices


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
class ConvergenceStudy:
    """χ on grids of growing resolution.

    Attributes:
        counts: one per grid, coarsest first, at least three.
        first_step: the largest step of the grid that was evaluated at every vertex, in units of length.
        euler: the integer that occurs most often in either connectivity, the coarsest grid left out; of several
            the one on the finest grid.
        has_converged: whether the counts agree on that integer, see `convergence_study`.
        shifted_eulers: χ on the last two grids with the level shifted up and down by a twentieth and a tenth of the
            field's typical change over one of their cells.
        n_unseen: places on the last grid where no sign changes, but the field reaches its level between the vertices,
            or comes within a tenth of its change over a cell.
        reached_faces: for each axis, whether the solid reaches the lower and the upper face of the box.
        shown: the coarsest grid that shows `euler` in both connectivities, of all if the counts agree, else of those
            that are kept; or the finest that is kept.
        field: the field on that grid; None if it was evaluated box by box.
        known: with which any box of that grid can be evaluated.
        n_evaluations: points at which the field was evaluated.
        finest: the grid of the last count.
    """

    counts: tuple[GridCount, ...]
    first_step: float
    euler: int
    has_converged: bool
    shifted_eulers: tuple[int, ...]
    n_unseen: int
    reached_faces: ReachedFaces
    shown: Grid
    field: AdaptiveField | None
    known: Refinements
    n_evaluations: int
    finest: Grid


_KEPT_CELLS = 256  # finer grids are evaluated box by box: as a whole they would take gigabytes
_SUCCESSIVE = 3  # grids in a row that must agree
_SHIFTS = (-0.1, -0.05, 0.05, 0.1)  # of the level, as shares of the field's change over one cell


@dataclass(frozen=True, eq=False)
class _Counted:
    """What is found on one grid; the field is None where it was evaluated box by box.

    Attributes:
        change: the field's typical change over a cell where it crosses the level.
        lone: of the last grid, see `unseen.lone_vertices`.
    """

    grid: Grid
    eulers: tuple[int, int]
    shifted: Sequence[int]
    change: float
    lone: Tensor
    reached_faces: ReachedFaces
    n_evaluations: int
    known: Refinements
    field: AdaptiveField | None

    @property
    def count(self) -> GridCount:
        return GridCount(self.grid.n_cells, self.grid.step, *self.eulers)


def convergence_study(
    coarsest: AdaptiveField,
    evaluate: Evaluate,
    finest: int,
    blocks: Blocks = ONE_BY_ONE,
    kept_cells: int | None = None,
) -> ConvergenceStudy:
    """Count χ on a grid and on grids of twice, four times, ... the cells.

    At least three grids are counted: where the first and the finest leave room for fewer, those of every second vertex
    of the first come before. The count has converged when both connectivities agree on one integer on the last three
    grids, no coarser grid agreed on a different integer, and shifting the level by a twentieth or a
    tenth of the field's change over one cell changes nothing on the last two grids. Two agreeing grids alone are not
    enough: see docs/paper-shapes.md for trained networks whose topology depends on the grid. Still no grid proves
    anything about what lies between its points.

    Args:
        coarsest: the field at every vertex of the first grid, with an even number of cells along each axis.
        evaluate: the field, as for `refine_grid`.
        finest: no grid gets more cells than this along its longest axis.
        blocks: how grids that are not kept are divided.
        kept_cells: cells along the longest axis up to which grids are evaluated as a whole and kept, 256 by default;
            which ones are changes no count.
    """
    found = list(_grids(coarsest, evaluate, finest, blocks, kept_cells or _KEPT_CELLS))
    counts = [*_coarser_counts(coarsest, _SUCCESSIVE - len(found)), *(one.count for one in found)]
    shifted = [euler for one in found for euler in one.shifted]
    euler = _most_frequent(counts)
    last = counts[-_SUCCESSIVE:]
    agreed = {count.euler_26 for count in counts if count.agrees}
    converged = all(count.agrees for count in last) and agreed == {euler} == set(shifted)
    n_unseen, n_looks = count_unseen(evaluate, found[-1].grid, found[-1].lone, _SHIFTS[-1] * found[-1].change)
    kept = [one for one in found if one.field is not None]
    showing = [one for one in (found if converged else kept) if one.eulers == (euler, euler)]
    shown = showing[0] if showing else kept[-1]
    return ConvergenceStudy(
        counts=tuple(counts),
        first_step=coarsest.grid.step,
        euler=euler,
        has_converged=converged,
        shifted_eulers=tuple(shifted),
        n_unseen=n_unseen,
        reached_faces=found[-1].reached_faces,
        shown=shown.grid,
        field=shown.field,
        known=shown.known,
        n_evaluations=sum(one.n_evaluations for one in found) + n_looks,
        finest=found[-1].grid,
    )


def reached_faces(values: Tensor) -> ReachedFaces:
    """For each axis, whether the solid reaches the first and the last layer of the grid (X, Y, Z)."""

    def reaches(axis: int, end: int) -> bool:
        return bool((values.select(axis, end) > 0).any())

    return tuple((reaches(axis, 0), reaches(axis, -1)) for axis in range(3))


def _grids(
    field: AdaptiveField, evaluate: Evaluate, finest: int, blocks: Blocks, kept_cells: int
) -> Iterator[_Counted]:
    """What is found on each grid, coarsest first."""
    known, n_before = Refinements(field, evaluate), 0
    while True:
        change, n_cells = _change_over_a_cell(field.values), field.grid.n_cells
        shifted = _eulers_at_shifted_levels(field, change) if n_cells > finest // 4 else []  # on the last two
        x, y, z = field.values.shape
        lone = lone_vertices(field, ((0, x), (0, y), (0, z))) if n_cells > finest // 2 else NONE
        n_own = field.n_evaluations - n_before
        eulers = _eulers_26_and_6(field, 0.0)
        yield _Counted(field.grid, eulers, shifted, change, lone, reached_faces(field.values), n_own, known, field)
        if 2 * field.grid.n_cells > finest:
            return
        if 2 * field.grid.n_cells > kept_cells:
            break
        n_before = field.n_evaluations
        field, followed = refine_grid(field, evaluate)
        known = replace(known, followed=(*known.followed, followed))
    if blocks.client is None:  # nothing is sent, so boxes may begin with the finest grid
        known = Refinements(field, evaluate)
    yield from _grids_in_boxes(known, change, finest, blocks)


def _grids_in_boxes(known: Refinements, change: float, finest: int, blocks: Blocks) -> Iterator[_Counted]:
    """What is found on each grid after the finest known one, given the field's typical change over a cell of that."""
    while 2 * known.grid.n_cells <= finest:
        shifts = _SHIFTS if 2 * known.grid.n_cells > finest // 4 else ()
        is_last = 4 * known.grid.n_cells > finest
        found = next_grid(known, blocks, change, max(shifts, default=0.0), is_last)
        known, change = found.known, change if found.change is None else found.change
        shifted = found.eulers_at_shifts(shifts)
        yield _Counted(
            known.grid, found.eulers, shifted, change, found.lone, found.reached_faces, found.n_evaluations, known, None
        )


def _coarser_counts(field: AdaptiveField, n_grids: int) -> list[GridCount]:
    """χ on the grids of every second, fourth, ... vertex, coarsest first."""
    counts: list[GridCount] = []
    for _ in range(n_grids):
        field = field.halved()
        counts.insert(0, GridCount(field.grid.n_cells, field.grid.step, *_eulers_26_and_6(field, 0.0)))
    return counts


def _eulers_at_shifted_levels(field: AdaptiveField, change: float) -> list[int]:
    return [euler for shift in _SHIFTS for euler in _eulers_26_and_6(field, shift * change)]


def _change_over_a_cell(values: Tensor) -> float:
    """The field's typical change from vertex to vertex where it crosses the level, as boxes find it, too."""
    return value_of(int(rounded(torch.tensor(typical_step(values)))))


def _eulers_26_and_6(field: AdaptiveField, level: float) -> tuple[int, int]:
    return int(surface_euler(field.values, level, 26)), int(surface_euler(field.values, level, 6))


def _most_frequent(counts: list[GridCount]) -> int:
    """The integer seen most often, of several the one on the finest grid; the coarsest grid is left out."""
    votes = [value for count in counts[1:] or counts for value in (count.euler_26, count.euler_6)]
    tally = Counter(votes)
    return max(reversed(votes), key=lambda value: tally[value])
