"""Evaluating a field on a fine grid only where its zero set may be: coarse to fine, with bounded memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

Evaluate = Callable[[Tensor], Tensor]
_NEAR = 1.0  # a cell is near the zero set when |F| is within this many of its own changes from corner to corner
_CHUNK = 1 << 16  # points per call of the field


@dataclass(frozen=True, eq=False)
class FieldGrid:
    """Values of a field on a regular grid, positive inside.

    Attributes:
        values: (X, Y, Z) on the CPU. Where `known` is False they are copies of a coarser neighbour, with its sign.
        known: (X, Y, Z) bool, the points at which the field was evaluated.
        origin: position of the first point, in units of length.
        spacing: step along each axis, in units of length.
        n_evaluations: points at which the field was evaluated so far, coarser grids included.
    """

    values: Tensor
    known: Tensor
    origin: tuple[float, float, float]
    spacing: tuple[float, float, float]
    n_evaluations: int

    @property
    def n_cells(self) -> int:
        """Cells along the longest axis."""
        return max(self.values.shape) - 1

    @property
    def step(self) -> float:
        """The largest step between grid points."""
        return max(self.spacing)

    def positions(self, flat_index: Tensor) -> Tensor:
        """Points (N, 3), float64, of flat indices (N,) into `values`."""
        _, n_y, n_z = self.values.shape
        steps = torch.stack((flat_index // (n_y * n_z), flat_index // n_z % n_y, flat_index % n_z), dim=-1)
        return steps * steps.new_tensor(self.spacing, dtype=torch.float64) + steps.new_tensor(
            self.origin, dtype=torch.float64
        )


def dense_grid(
    evaluate: Evaluate, low: tuple[float, float, float], high: tuple[float, float, float], n_cells: int
) -> FieldGrid:
    """Evaluate a field at every point of a grid over a box.

    Args:
        evaluate: maps (N, 3) float64 positions to (N,) values, positive inside; called with bounded N.
        low: lowest corner of the box.
        high: highest corner of the box.
        n_cells: cells along the longest side; the others get as many as keep the cells nearly cubic, at least 8.
    """
    sides = [b - a for a, b in zip(low, high, strict=True)]
    counts = [max(8, round(n_cells * side / max(sides))) for side in sides]
    spacing = (sides[0] / counts[0], sides[1] / counts[1], sides[2] / counts[2])
    shape = [count + 1 for count in counts]
    grid = FieldGrid(torch.empty(shape), torch.ones(shape, dtype=torch.bool), low, spacing, 0)
    values = _evaluate_at(grid, evaluate, torch.arange(grid.values.numel()))
    return FieldGrid(values.reshape(shape), grid.known, grid.origin, grid.spacing, values.numel())


def refine(grid: FieldGrid, evaluate: Evaluate) -> FieldGrid:
    """Halve the grid's step; evaluate only in cells near the zero set, and follow the zero set where it leads.

    A cell is near when the field changes its sign in it, or could within one more step of the change that is seen from
    corner to corner, or when it touches such a cell. |F| is never taken for a distance, so the scale of the field does
    not matter. What lies wholly inside a cell that is not near is not seen.

    Args:
        grid: the coarser grid.
        evaluate: as for `dense_grid`.
    """
    fine = _doubled(grid)
    wanted = _points_of_cells(_dilated(_near_cells(grid.values)))
    n_evaluations = grid.n_evaluations
    while True:
        index = (wanted & ~fine.known).reshape(-1).nonzero()[:, 0]
        if len(index) == 0:
            return FieldGrid(fine.values, fine.known, fine.origin, fine.spacing, n_evaluations)
        fine.values.view(-1)[index] = _evaluate_at(fine, evaluate, index)
        fine.known.view(-1)[index] = True
        n_evaluations += len(index)
        wanted = _around_sign_changes(fine.values > 0)


def _evaluate_at(grid: FieldGrid, evaluate: Evaluate, index: Tensor) -> Tensor:
    parts = [evaluate(grid.positions(rows)).to("cpu", grid.values.dtype) for rows in torch.split(index, _CHUNK)]
    return torch.cat(parts) if parts else grid.values.new_empty(0)


def _doubled(grid: FieldGrid) -> FieldGrid:
    """The grid with twice the cells, new points holding copies that are not known."""
    shape = [2 * n - 1 for n in grid.values.shape]
    values = grid.values.new_empty(shape)
    for x in (0, 1):
        for y in (0, 1):
            for z in (0, 1):
                part = values[x::2, y::2, z::2]
                part.copy_(grid.values[: part.shape[0], : part.shape[1], : part.shape[2]])
    known = torch.zeros(shape, dtype=torch.bool)
    known[::2, ::2, ::2] = grid.known
    spacing = (grid.spacing[0] / 2, grid.spacing[1] / 2, grid.spacing[2] / 2)
    return FieldGrid(values, known, grid.origin, spacing, grid.n_evaluations)


def _over_cells(values: Tensor, extreme: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    for axis in range(3):
        n = values.shape[axis]
        values = extreme(values.narrow(axis, 0, n - 1), values.narrow(axis, 1, n - 1))
    return values


def _near_cells(values: Tensor) -> Tensor:
    lowest, highest = _over_cells(values, torch.minimum), _over_cells(values, torch.maximum)
    reach = _NEAR * (highest - lowest)
    return (lowest <= reach) & (-highest <= reach)


def _dilated(mask: Tensor) -> Tensor:
    """The mask and the 26 neighbours of its members."""
    for axis in range(3):
        wider = mask.clone()
        n = mask.shape[axis]
        wider.narrow(axis, 1, n - 1).logical_or_(mask.narrow(axis, 0, n - 1))
        wider.narrow(axis, 0, n - 1).logical_or_(mask.narrow(axis, 1, n - 1))
        mask = wider
    return mask


def _points_of_cells(cells: Tensor) -> Tensor:
    """Points of the grid of half the step that lie in the closed cells."""
    for axis in range(3):
        shape = list(cells.shape)
        n = shape[axis]
        shape[axis] = 2 * n + 1
        points = cells.new_zeros(shape)
        index: list[slice] = [slice(None)] * 3
        for start in (0, 1, 2):
            index[axis] = slice(start, start + 2 * n - 1, 2)
            points[tuple(index)] |= cells
        cells = points
    return cells


def _around_sign_changes(inside: Tensor) -> Tensor:
    """Points of cells in which the sign changes, and of the cells beside those."""
    changes = _over_cells(inside, torch.logical_or) & ~_over_cells(inside, torch.logical_and)
    points = torch.zeros_like(inside)
    for x in (0, 1):
        for y in (0, 1):
            for z in (0, 1):
                n_x, n_y, n_z = changes.shape
                points[x : n_x + x, y : n_y + y, z : n_z + z] |= changes
    return _dilated(points)
