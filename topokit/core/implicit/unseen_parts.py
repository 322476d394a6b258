"""What grid points may not show of a level set: whether that can be said of a field, and where to look once more."""

from __future__ import annotations

from functools import reduce

import torch
from torch import Tensor

from topokit.core.grid.grid import Grid
from topokit.core.grid.tau import typical_step
from topokit.core.implicit.adaptive_grid import NONE, AdaptiveField, Box, Evaluate, dilate, is_near, over_cells

_FAR = 3  # cells from the zero set
_PLATEAU = 2.0  # typical changes over a cell: a field that is no farther from its level there may be a plateau
_PLATEAU_SHARE = 0.1  # of the far cells on either side that may be so near the level
_APART = 2  # cells around which no sign changes
_STEPS = 6  # of Newton's method
_DIFFERENCE = 1 / 16  # of a cell, between the points of a difference quotient and the place it is for
_MOST_PLACES = 4096  # that are examined
_MOST_POINTS = 1 << 16  # likewise, of which few are such places


def carries_distance(values: Tensor) -> bool:
    """Whether |F| says how far the zero set is, so that cells with large |F| can be left out.

    A part of the zero set inside a cell shows at the cell's corners if the field keeps rising for about two cells
    around the zero set. Steep occupancies do not: they are on a plateau at the next vertex, and nothing at the corners
    of a cell says what is in it.

    Args:
        values: (X, Y, Z) at every vertex of a grid, positive inside, with a change of sign.
    """
    values = values.double().nan_to_num(posinf=1e300, neginf=-1e300)
    lowest, highest = over_cells(values, torch.minimum), over_cells(values, torch.maximum)
    far = ~_around(((lowest <= 0) & (highest > 0)), _FAR)
    limit = _PLATEAU * typical_step(values)
    sides = lowest[far & (lowest > 0)], -highest[far & (highest <= 0)]
    return all(int((side <= limit).sum()) <= _PLATEAU_SHARE * len(side) for side in sides)


def lone_vertices(field: AdaptiveField, box: Box) -> Tensor:
    """Vertices (M,), flat on the grid, near which the zero set should be but no sign changes.

    In a cell that was evaluated |F| is within its own change from corner to corner, and within two cells of it no sign
    changes. Of each such cell the vertex with the smallest |F|.

    Args:
        field: with three more vertices around the box on all sides where the grid has them.
        box: of the grid, in which the cells begin.
    """
    values, inside = field.values, field.values > 0
    changes = over_cells(inside, torch.logical_or) & ~over_cells(inside, torch.logical_and)
    candidates = over_cells(field.known, torch.logical_and) & ~_around(changes, _APART)
    starts = [start - at for (start, _), at in zip(box, field.first, strict=True)]
    own = tuple(slice(at, at + stop - start) for at, (start, stop) in zip(starts, box, strict=True))
    cells = candidates[own].nonzero() + torch.tensor(starts)
    if not len(cells):
        return NONE
    _, n_y, n_z = values.shape
    first = (cells[:, 0] * n_y + cells[:, 1]) * n_z + cells[:, 2]
    corners = torch.stack([first + (x * n_y + y) * n_z + z for x in (0, 1) for y in (0, 1) for z in (0, 1)], 1)
    at_corners = values.reshape(-1)[corners]
    near = is_near(at_corners.amin(1), at_corners.amax(1))
    closest = at_corners[near].abs().argmin(1, keepdim=True)
    return field.flat_on_grid(corners[near].gather(1, closest)[:, 0].unique())


def count_unseen(evaluate: Evaluate, grid: Grid, lone: Tensor, nearest: float) -> tuple[int, int]:
    """Near how many lone vertices the field does reach its level, and the number of evaluations.

    From each vertex Newton's method, on difference quotients, goes at most a cell far.

    Args:
        evaluate: the field, as for `adaptive_grid.dense_field`.
        grid: that of the vertices.
        lone: (M,) flat indices, as of `lone_vertices`; where there are many, evenly spread ones are examined.
        nearest: |F| that counts as reached.
    """
    if not len(lone):
        return 0, 0
    starts = grid.positions(lone[:: -(-len(lone) // _MOST_PLACES)])
    cell, origin = starts.new_tensor(grid.spacing), starts.new_tensor(grid.origin)
    offsets = _DIFFERENCE * cell
    low = torch.maximum(starts - cell, origin + offsets)  # so that nothing outside of the box is evaluated
    high = torch.minimum(starts + cell, origin + cell * (starts.new_tensor(grid.shape) - 1) - offsets)
    points = starts.clamp(low, high)
    value = evaluate(points).cpu().double()
    was_inside, reached = value > 0, value.abs() <= nearest
    for _ in range(_STEPS):
        around = (points[:, None] + torch.cat((offsets.diag(), -offsets.diag()))).reshape(-1, 3)
        after, before = evaluate(around).cpu().double().reshape(-1, 2, 3).unbind(1)
        gradient = (after - before) / (2 * offsets)
        square = gradient.square().sum(1)
        usable = (square > 0) & square.isfinite() & value.isfinite()
        points = torch.where(usable[:, None], points - (value / square)[:, None] * gradient, points).clamp(low, high)
        value = evaluate(points).cpu().double()
        reached |= (value.abs() <= nearest) | ((value > 0) != was_inside)
    return int(reached.sum()), len(starts) * (1 + 7 * _STEPS)


def count_hidden(evaluate: Evaluate, grid: Grid, points: Tensor) -> int:
    """At how many of some points the field has a sign that no vertex of the grid within two cells has.

    Args:
        evaluate: the field, as for `adaptive_grid.dense_field`.
        grid: what sees the field at its vertices.
        points: (M, 3) in the box of the grid; where there are many, evenly spread ones are examined.
    """
    points = points[:: -(-len(points) // _MOST_POINTS) or 1]
    last = torch.tensor(grid.shape) - 1
    cell = ((points - points.new_tensor(grid.origin)) / points.new_tensor(grid.spacing)).floor().long()
    inside = evaluate(points).cpu() > 0
    for reach in (0, _APART):
        near = torch.cartesian_prod(*[torch.arange(-reach, reach + 2)] * 3)
        vertices = (cell[:, None] + near).clamp(torch.zeros_like(last), last)
        index = (vertices[..., 0] * grid.shape[1] + vertices[..., 1]) * grid.shape[2] + vertices[..., 2]
        around = evaluate(grid.positions(index.reshape(-1))).cpu() > 0
        is_hidden = (around.reshape(index.shape) != inside[:, None]).all(1)
        cell, inside = cell[is_hidden][:_MOST_PLACES], inside[is_hidden][:_MOST_PLACES]
    return len(cell)


def _around(cells: Tensor, distance: int) -> Tensor:
    return reduce(lambda found, _: dilate(found), range(distance), cells)
