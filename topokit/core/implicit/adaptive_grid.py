"""Evaluation of a field on a fine grid only near its zero set: coarse to fine, of the whole grid or of a box of it.

Which vertices are evaluated does not depend on the order in which that is done, so a box knows what the whole grid
knows there as soon as it has got the places where the zero set led from outside.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import torch
from torch import Tensor

from topokit.core.grid.grid import Grid
from topokit.core.progress import advance, begin, stages

Evaluate = Callable[[Tensor], Tensor]
Box = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
"""First and last + 1 vertex along each axis."""

_NEAR = 1.0  # a cell is near the zero set when |F| is within this many of its own changes from corner to corner
_CHUNK = 1 << 16  # points per call of the field
_NEAR_CELLS = 20.0  # evaluations near a surface for each square cell of a side of its box, about


@dataclass(frozen=True, eq=False)
class AdaptiveField:
    """Values of a field on a regular grid or in a box of it, positive inside, evaluated where the zero set may be.

    Attributes:
        grid: the whole grid.
        values: (X, Y, Z) on the CPU. Where `known` is False they are copies of a coarser neighbor, with its sign.
        known: (X, Y, Z) bool, the vertices at which the field was evaluated.
        n_evaluations: points at which the field was evaluated so far, coarser grids included.
        first: vertex of the grid at which the values begin.
    """

    grid: Grid
    values: Tensor
    known: Tensor
    n_evaluations: int
    first: tuple[int, int, int] = (0, 0, 0)

    def part(self, box: Box) -> AdaptiveField:
        """The values in a box, which must lie in the own one; memory is shared, and no evaluation is counted."""
        own = tuple(slice(start - at, stop - at) for (start, stop), at in zip(box, self.first, strict=True))
        (x, _), (y, _), (z, _) = box
        return AdaptiveField(self.grid, self.values[own], self.known[own], 0, (x, y, z))

    def halved(self) -> AdaptiveField:
        """Every second vertex along each axis, of a whole grid with an even number of cells; nothing is evaluated."""
        grid = self.grid.coarsened()
        return AdaptiveField(grid, self.values[::2, ::2, ::2], self.known[::2, ::2, ::2], 0)

    def flat_on_grid(self, index: Tensor) -> Tensor:
        """Flat indices on the grid (N,) of values given by their own flat indices (N,)."""
        _, m_y, m_z = self.grid.shape
        x, y, z = torch.unravel_index(index, self.values.shape)
        return ((x + self.first[0]) * m_y + y + self.first[1]) * m_z + z + self.first[2]

    def flat_in_box(self, index: Tensor) -> Tensor:
        """Own flat indices (M,) of those vertices, of some (N,) given by flat indices on the grid, that are here."""
        n_x, n_y, n_z = self.values.shape
        vertices = torch.stack(torch.unravel_index(index, self.grid.shape), 1)
        vertices = vertices - vertices.new_tensor(self.first)
        x, y, z = vertices[((vertices >= 0) & (vertices < vertices.new_tensor((n_x, n_y, n_z)))).all(1)].unbind(1)
        return (x * n_y + y) * n_z + z


class Refined(NamedTuple):
    """A field on a grid of half the step.

    Attributes:
        field: its values.
        followed: (M,) flat indices on the grid, of vertices that were evaluated only because the zero set led there.
    """

    field: AdaptiveField
    followed: Tensor


NONE = torch.zeros(0, dtype=torch.int64)
"""No vertices."""


def grid_stages(coarsest: int, finest: int) -> dict[str, float]:
    """The stages of a field's evaluation on grids of twice, four times, ... the cells, by the number of evaluations.

    Args:
        coarsest: cells along the longest axis of the first grid, which is evaluated at every vertex.
        finest: the most cells of the last.
    """
    weights, n_cells = {stage_of(coarsest): float(coarsest**3)}, 2 * coarsest
    while n_cells <= finest:
        weights[stage_of(n_cells)] = _NEAR_CELLS * n_cells**2
        n_cells *= 2
    return weights


def stage_of(n_cells: int) -> str:
    """The name of the stage in which a grid is evaluated."""
    return f"grid of {n_cells} cells"


def dense_field(evaluate: Evaluate, grid: Grid) -> AdaptiveField:
    """Evaluate a field at every vertex of a grid.

    Args:
        evaluate: maps (N, 3) float64 positions to (N,) values, positive inside; called with bounded N.
        grid: where to evaluate.
    """
    values = _evaluate_at(grid, evaluate, torch.arange(grid.n_vertices), torch.get_default_dtype())
    known = torch.ones(grid.shape, dtype=torch.bool)
    return AdaptiveField(grid, values.reshape(grid.shape), known, grid.n_vertices)


def refined_everywhere(field: AdaptiveField, evaluate: Evaluate) -> AdaptiveField:
    """The field at every vertex of the grid of half the step; arguments as for `refine_grid`."""
    n_x, n_y, n_z = field.grid.refined().shape
    fine, _ = _upsample(field, ((0, n_x), (0, n_y), (0, n_z)))
    index = (~fine.known).reshape(-1).nonzero()[:, 0]
    fine.values.view(-1)[index] = _evaluate_at(fine.grid, evaluate, index, fine.values.dtype)
    fine.known.fill_(True)
    return replace(fine, n_evaluations=field.n_evaluations + len(index))


def refine_grid(field: AdaptiveField, evaluate: Evaluate) -> Refined:
    """Halve the grid's step; evaluate only in cells near the zero set, and follow the zero set where it leads.

    A cell is near when the field changes its sign in it, or would within one more step of the change from corner to
    corner, or when it touches such a cell. |F| is never taken for a distance, so the scale of the field does not
    matter. The zero set leads on where an evaluated value has another sign than one around it, or than the copy of the
    coarser value that stood there. What lies wholly inside a cell that is not near is not seen.

    Args:
        field: values on the coarser grid.
        evaluate: as for `dense_field`.
    """
    n_x, n_y, n_z = field.grid.refined().shape
    return _refine(field, ((0, n_x), (0, n_y), (0, n_z)), evaluate, NONE)


def refine_in_box(
    base: AdaptiveField, box: Box, evaluate: Evaluate, followed: Sequence[Tensor], window: float = 0.0
) -> Refined | bool:
    """Refine a field several times as `refine_grid` does, but only as far as a box of the last grid needs it.

    Args:
        base: values on the whole of the first grid.
        box: of the last grid.
        evaluate: as for `dense_field`.
        followed: of each refinement, the vertices `followed` that are known. With all of them the result is that of
            `refine_grid`; of the last refinement those that the box can find by itself may be missing.
        window: which |F| are of interest besides the zero set.

    Returns:
        The field in the box; or, if the zero set does not come near and |F| is above the window, whether all of the box
        is inside.
    """
    shapes = [base.grid.shape]
    for _ in followed:
        x, y, z = shapes[-1]
        shapes.append((2 * x - 1, 2 * y - 1, 2 * z - 1))
    boxes = [box]
    for shape in shapes[-2::-1]:
        boxes.append(_needed(boxes[-1], shape))
    refined = Refined(base.part(boxes.pop()), NONE)
    may_follow = any(len(known) for known in followed)
    for known in followed:
        values = refined.field.values
        if not may_follow and not _near_cells(values).any() and not (values.abs() <= window).any():
            return bool(values[0, 0, 0] > 0)
        with stages({}):  # a box is a part of a stage
            refined = _refine(refined.field, boxes.pop(), evaluate, known)
    return refined


def _needed(box: Box, shape: tuple[int, int, int]) -> Box:
    """The box of a grid of this shape on which a box of the grid of half its step depends: two cells farther."""
    x, y, z = ((max(0, (a - 3) // 2), min(n, (b + 5) // 2)) for (a, b), n in zip(box, shape, strict=True))
    return x, y, z


def _refine(field: AdaptiveField, box: Box, evaluate: Evaluate, known: Tensor) -> Refined:
    fine, seeds = _upsample(field, box)
    copies, before = fine.values > 0, fine.known.clone()
    wanted = seeds.clone()
    wanted.view(-1)[fine.flat_in_box(known)] = True
    n_evaluations = 0
    while len(index := (wanted & ~fine.known).reshape(-1).nonzero()[:, 0]):
        on_grid = fine.flat_on_grid(index)
        fine.values.view(-1)[index] = _evaluate_at(fine.grid, evaluate, on_grid, fine.values.dtype)
        fine.known.view(-1)[index] = True
        n_evaluations += len(index)
        inside = fine.values > 0
        wanted = _vertices_around_changes(inside | copies, inside & copies)
    followed = (fine.known & ~before & ~seeds).reshape(-1).nonzero()[:, 0]
    done = replace(fine, n_evaluations=field.n_evaluations + n_evaluations)
    return Refined(done, fine.flat_on_grid(followed))


def _evaluate_at(grid: Grid, evaluate: Evaluate, index: Tensor, dtype: torch.dtype) -> Tensor:
    """Values (N,) on the CPU at vertices given by their flat index (N,)."""
    values = torch.empty(len(index), dtype=dtype)
    begin(stage_of(grid.n_cells))
    for start in range(0, len(index), _CHUNK):
        rows = slice(start, start + _CHUNK)
        values[rows] = evaluate(grid.positions(index[rows])).to("cpu", dtype)
        advance(min(1.0, (start + _CHUNK) / len(index)))
    return values


def _upsample(field: AdaptiveField, box: Box) -> tuple[AdaptiveField, Tensor]:
    """The field in a box of the grid of half the step; and which of its vertices are near the zero set.

    New vertices hold copies that are not known.
    """
    n_x, n_y, n_z = ((stop - start) for start, stop in box)
    values, known = field.values.new_empty((n_x, n_y, n_z)), torch.zeros((n_x, n_y, n_z), dtype=torch.bool)
    offsets = [start - 2 * at for (start, _), at in zip(box, field.first, strict=True)]
    for odd in product((0, 1), repeat=3):
        begin = [(offset + one) % 2 for offset, one in zip(offsets, odd, strict=True)]
        part = tuple(slice(b, None, 2) for b in begin)
        source = [(offset + b) // 2 for offset, b in zip(offsets, begin, strict=True)]
        taken = tuple(slice(a, a + n) for a, n in zip(source, values[part].shape, strict=True))
        values[part] = field.values[taken]
        if not any(odd):
            known[part] = field.known[taken]
    near = _near_cells(field.values)
    seeds = torch.zeros_like(known)
    if near.any():
        in_box = tuple(slice(a, a + n) for a, n in zip(offsets, values.shape, strict=True))
        seeds = _vertices_of_cells(dilate(near))[in_box]
    (x, _), (y, _), (z, _) = box
    return AdaptiveField(field.grid.refined(), values, known, 0, (x, y, z)), seeds


def over_cells(values: Tensor, extreme: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    """The extreme value over the 8 corners of every cell."""
    for axis in range(3):
        n = values.shape[axis]
        values = extreme(values.narrow(axis, 0, n - 1), values.narrow(axis, 1, n - 1))
    return values


def _near_cells(values: Tensor) -> Tensor:
    lowest, highest = over_cells(values, torch.minimum), over_cells(values, torch.maximum)
    return is_near(lowest, highest)


def is_near(lowest: Tensor, highest: Tensor) -> Tensor:
    """Whether cells with these extreme values at their corners are near the zero set."""
    reach = _NEAR * (highest - lowest)
    return (lowest <= reach) & (-highest <= reach)


def dilate(mask: Tensor) -> Tensor:
    """The mask and the 26 neighbors of its True entries."""
    for axis in range(3):
        wider = mask.clone()
        n = mask.shape[axis]
        wider.narrow(axis, 1, n - 1).logical_or_(mask.narrow(axis, 0, n - 1))
        wider.narrow(axis, 0, n - 1).logical_or_(mask.narrow(axis, 1, n - 1))
        mask = wider
    return mask


def _vertices_of_cells(cells: Tensor) -> Tensor:
    """Vertices of the grid of half the step that lie in the closed cells."""
    for axis in range(3):
        shape = list(cells.shape)
        n = shape[axis]
        shape[axis] = 2 * n + 1
        vertices = cells.new_zeros(shape)
        index: list[slice] = [slice(None)] * 3
        for start in (0, 1, 2):
            index[axis] = slice(start, start + 2 * n - 1, 2)
            vertices[tuple(index)] |= cells
        cells = vertices
    return cells


def _vertices_around_changes(some: Tensor, every: Tensor) -> Tensor:
    """Vertices of cells in which not all are alike, and of the cells beside those.

    Args:
        some: (X, Y, Z), whether a vertex has been inside at some time.
        every: (X, Y, Z), whether it has been inside at every time.
    """
    changes = over_cells(some, torch.logical_or) & ~over_cells(every, torch.logical_and)
    vertices = torch.zeros_like(some)
    for x, y, z in product((0, 1), repeat=3):
        n_x, n_y, n_z = changes.shape
        vertices[x : n_x + x, y : n_y + y, z : n_z + z] |= changes
    return dilate(vertices)
