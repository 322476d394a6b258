"""Grid convergence study: χ of a level set on finer and finer grids, until the counts agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from torch import Tensor

from topokit.core.grid.euler import surface_euler
from topokit.core.grid.field import median_step_at_crossings
from topokit.core.implicit.adaptive_grid import AdaptiveField, Evaluate, Progress, no_progress, refine_grid

ReachedFaces = tuple[tuple[bool, bool], ...]


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
        counts: one per grid, coarsest first.
        euler: the integer that occurs most often in either connectivity, the coarsest grid left out; of several
            the one on the finest grid.
        has_converged: whether the counts agree on that integer, see `convergence_study`.
        shifted_eulers: χ on the last two grids with the level shifted up and down by a twentieth and a tenth of the
            field's typical change over one of their cells.
        reached_faces: for each axis, whether the solid reaches the lower and the upper face of the box.
        field: that on the coarsest grid that shows `euler` in both connectivities, else on the finest that is kept.
        n_evaluations: points at which the field was evaluated.
        n_vertices: vertices of the finest grid.
    """

    counts: tuple[GridCount, ...]
    euler: int
    has_converged: bool
    shifted_eulers: tuple[int, ...]
    reached_faces: ReachedFaces
    field: AdaptiveField
    n_evaluations: int
    n_vertices: int


_KEPT_CELLS = 256  # finer grids are counted, not kept: labels of their components would take gigabytes
_SUCCESSIVE = 3  # grids in a row that must agree
_SHIFTS = (-0.1, -0.05, 0.05, 0.1)  # of the level, as shares of the field's change over one cell


def convergence_study(
    coarsest: AdaptiveField, evaluate: Evaluate, finest: int, progress: Progress = no_progress
) -> ConvergenceStudy:
    """Count χ on a grid and on grids of twice, four times, ... the cells.

    The count has converged when both connectivities agree on one integer on the last three grids (or on all of them,
    where there are only two), no coarser grid agreed on a different integer, and shifting the level by a twentieth or a
    tenth of the field's change over one cell changes nothing on the last two grids. Two agreeing grids alone are not
    enough: see docs/paper-shapes.md for trained networks whose topology depends on the grid. Still no grid proves
    anything about what lies between its points.

    Args:
        coarsest: the field on the coarsest grid.
        evaluate: the field, as for `refine_grid`.
        finest: no grid gets more cells than this along its longest axis.
        progress: told how many points of each grid are evaluated.
    """
    counts: list[GridCount] = []
    kept: list[AdaptiveField] = []
    shifted: list[int] = []
    for field in _refinements(coarsest, evaluate, finest, progress):
        n_cells = field.grid.n_cells
        counts.append(GridCount(n_cells, field.grid.step, *_eulers_26_and_6(field, 0.0)))
        if n_cells <= _KEPT_CELLS or not kept:
            kept.append(field)
        if n_cells > finest // 4:  # the last two
            shifted += _eulers_at_shifted_levels(field)
    euler = _most_frequent(counts)
    last = counts[-_SUCCESSIVE:]
    agreed = {count.euler_26 for count in counts if count.agrees}
    converged = len(last) > 1 and all(count.agrees for count in last) and agreed == {euler} == set(shifted)
    showing = [one for one, count in zip(kept, counts, strict=False) if count.agrees and count.euler_26 == euler]
    return ConvergenceStudy(
        counts=tuple(counts),
        euler=euler,
        has_converged=converged,
        shifted_eulers=tuple(shifted),
        reached_faces=reached_faces(field.values),
        field=showing[0] if showing else kept[-1],
        n_evaluations=field.n_evaluations,
        n_vertices=field.grid.n_vertices,
    )


def reached_faces(values: Tensor) -> ReachedFaces:
    """For each axis, whether the solid reaches the first and the last layer of the grid (X, Y, Z)."""

    def reaches(axis: int, end: int) -> bool:
        return bool((values.select(axis, end) > 0).any())

    return tuple((reaches(axis, 0), reaches(axis, -1)) for axis in range(3))


def _refinements(field: AdaptiveField, evaluate: Evaluate, finest: int, progress: Progress) -> Iterator[AdaptiveField]:
    yield field
    while 2 * field.grid.n_cells <= finest:
        field = refine_grid(field, evaluate, progress)
        yield field


def _eulers_at_shifted_levels(field: AdaptiveField) -> list[int]:
    change = median_step_at_crossings(field.values)
    return [euler for shift in _SHIFTS for euler in _eulers_26_and_6(field, shift * change)]


def _eulers_26_and_6(field: AdaptiveField, level: float) -> tuple[int, int]:
    return int(surface_euler(field.values, level, 26)), int(surface_euler(field.values, level, 6))


def _most_frequent(counts: list[GridCount]) -> int:
    """The integer seen most often, of several the one on the finest grid; the coarsest grid is left out."""
    votes = [value for count in counts[1:] or counts for value in (count.euler_26, count.euler_6)]
    tally = Counter(votes)
    return max(reversed(votes), key=lambda value: tally[value])
