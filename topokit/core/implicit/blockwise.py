"""Grids of a field that are evaluated box by box: in bounded memory, here or on the workers of a Dask cluster.

Every box is refined from the first grid on, with as much around it as it depends on, and only its numbers are kept. The
one thing that a box cannot know is where the zero set led from other boxes: such vertices are collected, and boxes that
lack some are done again with them, until none does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from topokit.core.blocks.division import Division
from topokit.core.blocks.on_dask import mapped
from topokit.core.grid.grid import Grid
from topokit.core.implicit.adaptive_grid import (
    NONE,
    AdaptiveField,
    Box,
    Evaluate,
    refine_in_box,
    stage_of,
)
from topokit.core.implicit.box_counts import (
    BoxCounts,
    ReachedFaces,
    count_box,
    count_quiet_box,
    eulers_at,
    median_change,
)
from topokit.core.progress import advance, begin

MOST_VERTICES = 1 << 21  # in a box: small ones are more often far from the surface; smaller ones repeat more
_SPARE = 1.05  # factor on the change expected over a cell, from the coarser grid, up to which values count


@dataclass(frozen=True, eq=False)
class Refinements:
    """What is known of a field's grids: enough to evaluate any box of the finest one. It is sent to workers.

    Attributes:
        base: the field on the whole of a grid.
        evaluate: the field, as for `dense_field`.
        followed: for each grid finer than that, the vertices to which the zero set led (see `adaptive_grid.Refined`).
    """

    base: AdaptiveField
    evaluate: Evaluate
    followed: tuple[Tensor, ...] = ()

    @property
    def grid(self) -> Grid:
        """The finest grid."""
        grid = self.base.grid
        for _ in self.followed:
            grid = grid.refined()
        return grid


@dataclass(frozen=True)
class Blocks:
    """How grids are divided, and who evaluates them.

    Attributes:
        most_vertices: in a box.
        client: of a Dask cluster, or None for this process, one box after the other.
    """

    most_vertices: int = MOST_VERTICES
    client: Any = None


ONE_BY_ONE = Blocks()


@dataclass(frozen=True)
class _Task:
    """A box to count, and the vertices in it or around it to which the zero set leads from other boxes."""

    box: Box
    followed: Tensor = field(default_factory=lambda: NONE)


@dataclass(frozen=True, eq=False)
class _Work:
    """The count of a box of the grid after the finest known one."""

    known: Refinements
    window: float
    is_last: bool

    def __call__(self, task: _Task) -> BoxCounts:
        shape = self.known.grid.refined().shape
        followed = (*self.known.followed, task.followed)
        refined = refine_in_box(self.known.base, _wider(task.box, shape), self.known.evaluate, followed, self.window)
        if isinstance(refined, bool):
            return count_quiet_box(refined, task.box, shape, self.known.base.values.dtype)
        return count_box(refined, task.box, self.window, finds_lone=self.is_last)


@dataclass(frozen=True, eq=False)
class GridInBoxes:
    """A grid that was evaluated box by box.

    Attributes:
        known: all that is known now, this grid included.
        boxes: what was counted in each box.
        change: the median change along edges that cross the zero set, rounded down to 8 bits; None without such edges.
        n_evaluations: points at which the field was evaluated for this grid, with those of coarser grids that it took.
    """

    known: Refinements
    boxes: Sequence[BoxCounts]
    change: float | None
    n_evaluations: int

    def eulers_at_shifts(self, shifts: Sequence[float]) -> list[int]:
        """χ with connectivity 26 and 6 at levels given as shares of the change; see `next_grid` for the largest."""
        return [euler for shift in shifts for euler in eulers_at(self.boxes, shift * (self.change or 0.0))]

    @property
    def eulers(self) -> tuple[int, int]:
        """χ of the surface with connectivity 26 and 6."""
        return eulers_at(self.boxes, 0.0)

    @property
    def lone(self) -> Tensor:
        """Lone vertices of all boxes (see `unseen.lone_vertices`), ascending."""
        return torch.cat([one.lone for one in self.boxes]).unique()

    @property
    def reached_faces(self) -> ReachedFaces:
        """For each axis, whether the solid reaches the first and the last layer of the grid."""
        ends = zip(*(one.reached_faces for one in self.boxes), strict=True)
        return tuple((any(low for low, _ in axis), any(high for _, high in axis)) for axis in ends)


def next_grid(
    known: Refinements,
    blocks: Blocks,
    expected: float,
    largest_shift: float,
    is_last: bool = False,
) -> GridInBoxes:
    """The grid of half the step of the finest one, evaluated box by box.

    Args:
        known: the grids so far.
        blocks: how to divide it.
        expected: the change along edges that cross the zero set, at most; with more than that all is done again.
        largest_shift: the largest |shift| that `eulers_at_shifts` will be asked for; 0 for none.
        is_last: whether to find lone vertices, too.
    """
    grid, n_evaluations = known.grid.refined(), 0
    while True:
        window = _SPARE * largest_shift * expected
        found, n_more = _all_boxes(_Work(known, window, is_last), grid, blocks)
        n_evaluations += n_more
        change = median_change(found)
        if change is None or change <= expected or not largest_shift:
            followed = torch.cat([one.followed for one in found]).unique()
            return GridInBoxes(replace(known, followed=(*known.followed, followed)), found, change, n_evaluations)
        expected = change


def _all_boxes(work: _Work, grid: Grid, blocks: Blocks) -> tuple[list[BoxCounts], int]:
    """The counts of all boxes once they agree on where the zero set leads, and the evaluations that this took."""
    tasks = [_Task(box) for box in Division.even(grid.shape, blocks.most_vertices).boxes]
    found: dict[int, BoxCounts] = {}
    left, n_evaluations = list(range(len(tasks))), 0
    begin(stage_of(grid.n_cells))
    while left:
        n_done = len(tasks) - len(left)
        for number, counts in zip(left, mapped(work, [tasks[n] for n in left], blocks.client), strict=True):
            found[number] = counts
            n_evaluations += counts.n_evaluations
            n_done += 1
            advance(n_done / len(tasks))
        followed = torch.cat([one.followed for one in found.values()]).unique()
        left = []
        for number, task in enumerate(tasks if len(followed) else ()):
            here = followed[_is_in(followed, _wider(task.box, grid.shape), grid.shape)]
            if not torch.isin(here, found[number].followed).all():
                tasks[number] = _Task(task.box, here)
                left.append(number)
    return [found[number] for number in range(len(tasks))], n_evaluations


def _wider(box: Box, shape: tuple[int, int, int]) -> Box:
    """The box and the vertices that it needs around it: two to follow the zero set, three to find lone vertices."""
    x, y, z = ((max(0, a - 3), min(n, b + 3)) for (a, b), n in zip(box, shape, strict=True))
    return x, y, z


def _is_in(index: Tensor, box: Box, shape: tuple[int, int, int]) -> Tensor:
    """Whether vertices (N,), given by their flat indices on a grid, are in a box."""
    (a, b), (c, d), (e, f) = box
    x, y, z = torch.unravel_index(index, shape)
    return (x >= a) & (x < b) & (y >= c) & (y < d) & (z >= e) & (z < f)
