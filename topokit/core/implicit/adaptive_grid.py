"""Evaluation of a field on a fine grid only near its zero set: coarse to fine, with bounded memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from topokit.core.grid.grid import Grid

Evaluate = Callable[[Tensor], Tensor]
Progress = Callable[[Grid, int, int], None]
"""Told after each block of points: the grid, the points evaluated so far, and the points to evaluate."""

_NEAR = 1.0  # a cell is near the zero set when |F| is within this many of its own changes from corner to corner
_CHUNK = 1 << 16  # points per call of the field


@dataclass(frozen=True, eq=False)
class AdaptiveField:
    """Values of a field on a regular grid, positive inside, evaluated only where the zero set may be.

    Attributes:
        grid: where the values are.
        values: (X, Y, Z) on the CPU. Where `known` is False they are copies of a coarser neighbor, with its sign.
        known: (X, Y, Z) bool, the vertices at which the field was evaluated.
        n_evaluations: points at which the field was evaluated so far, coarser grids included.
    """

    grid: Grid
    values: Tensor
    known: Tensor
    n_evaluations: int


def no_progress(grid: Grid, done: int, total: int) -> None:
    """A `Progress` that shows nothing."""


def dense_field(evaluate: Evaluate, grid: Grid, progress: Progress = no_progress) -> AdaptiveField:
    """Evaluate a field at every vertex of a grid.

    Args:
        evaluate: maps (N, 3) float64 positions to (N,) values, positive inside; called with bounded N.
        grid: where to evaluate.
        progress: told how many points are evaluated.
    """
    values = _evaluate_at(grid, evaluate, torch.arange(grid.n_vertices), torch.get_default_dtype(), progress)
    known = torch.ones(grid.shape, dtype=torch.bool)
    return AdaptiveField(grid, values.reshape(grid.shape), known, grid.n_vertices)


def refine_grid(field: AdaptiveField, evaluate: Evaluate, progress: Progress = no_progress) -> AdaptiveField:
    """Halve the grid's step; evaluate only in cells near the zero set, and follow the zero set where it leads.

    A cell is near when the field changes its sign in it, or would within one more step of the change from corner to
    corner, or when it touches such a cell. |F| is never taken for a distance, so the scale of the field does not
    matter. What lies wholly inside a cell that is not near is not seen.

    Args:
        field: values on the coarser grid.
        evaluate: as for `dense_field`.
        progress: told how many points are evaluated.
    """
    fine = _upsample(field)
    wanted = _vertices_of_cells(_dilate(_near_cells(field.values)))
    n_evaluations = field.n_evaluations
    while True:
        index = (wanted & ~fine.known).reshape(-1).nonzero()[:, 0]
        if len(index) == 0:
            return replace(fine, n_evaluations=n_evaluations)
        fine.values.view(-1)[index] = _evaluate_at(fine.grid, evaluate, index, fine.values.dtype, progress)
        fine.known.view(-1)[index] = True
        n_evaluations += len(index)
        wanted = _vertices_around_sign_changes(fine.values > 0)


def _evaluate_at(grid: Grid, evaluate: Evaluate, index: Tensor, dtype: torch.dtype, progress: Progress) -> Tensor:
    """Values (N,) on the CPU at vertices given by their flat index (N,)."""
    values = torch.empty(len(index), dtype=dtype)
    for start in range(0, len(index), _CHUNK):
        rows = slice(start, start + _CHUNK)
        values[rows] = evaluate(grid.positions(index[rows])).to("cpu", dtype)
        progress(grid, min(start + _CHUNK, len(index)), len(index))
    return values


def _upsample(field: AdaptiveField) -> AdaptiveField:
    """The field on the grid of half the step; new vertices hold copies that are not known."""
    grid = field.grid.refined()
    values = field.values.new_empty(grid.shape)
    for x in (0, 1):
        for y in (0, 1):
            for z in (0, 1):
                part = values[x::2, y::2, z::2]
                part.copy_(field.values[: part.shape[0], : part.shape[1], : part.shape[2]])
    known = torch.zeros(grid.shape, dtype=torch.bool)
    known[::2, ::2, ::2] = field.known
    return AdaptiveField(grid, values, known, field.n_evaluations)


def _over_cells(values: Tensor, extreme: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    """The extreme value over the 8 corners of every cell."""
    for axis in range(3):
        n = values.shape[axis]
        values = extreme(values.narrow(axis, 0, n - 1), values.narrow(axis, 1, n - 1))
    return values


def _near_cells(values: Tensor) -> Tensor:
    lowest, highest = _over_cells(values, torch.minimum), _over_cells(values, torch.maximum)
    reach = _NEAR * (highest - lowest)
    return (lowest <= reach) & (-highest <= reach)


def _dilate(mask: Tensor) -> Tensor:
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


def _vertices_around_sign_changes(inside: Tensor) -> Tensor:
    """Vertices of cells in which the sign changes, and of the cells beside those."""
    changes = _over_cells(inside, torch.logical_or) & ~_over_cells(inside, torch.logical_and)
    vertices = torch.zeros_like(inside)
    for x in (0, 1):
        for y in (0, 1):
            for z in (0, 1):
                n_x, n_y, n_z = changes.shape
                vertices[x : n_x + x, y : n_y + y, z : n_z + z] |= changes
    return _dilate(vertices)
