"""Points on a level set: starts from a grid, Newton projection, and the implicit function theorem."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from topokit.core.arrays import Floats
from topokit.core.draws import stratified_draw
from topokit.core.grid.grid import Grid
from topokit.core.linalg import normalize

Evaluate = Callable[[Tensor], Tensor]
ValueAndGradient = Callable[[Tensor], tuple[Tensor, Tensor]]
_STEPS = 40
_CROSSING_STEPS = 4  # of the Illinois method; on smooth fields the error is then far below a millionth of a cell
_CHUNK = 1 << 16  # points per call of the field


def area_weighted_starts(
    values: Tensor, grid: Grid, n_points: int, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Points near the zero set of a field on a grid, distributed in proportion to area.

    The zero set crosses grid edges at the vertices of marching cubes. Each crossing along one axis stands for a patch
    whose projection along that axis is one face of the grid. Weighted with that face times |n_axis|, the sum over the
    three axes is unbiased, because n_x² + n_y² + n_z² = 1. A start is a crossing moved at random over its face.

    Args:
        values: (X, Y, Z), with a change of sign.
        grid: where the values are.
        n_points: number of starts.
        generator: source of randomness on the CPU.

    Returns:
        Starts (n, 3), float64, and unit normals (n, 3) at the crossings toward lower values, from differences on the
        grid.
    """
    steps = torch.tensor(grid.spacing, dtype=torch.float64)
    found = [_crossings(values, axis, steps) for axis in range(3)]
    position, normal, axis, weight = (torch.cat(column) for column in zip(*found, strict=True))
    chosen = stratified_draw(weight, n_points, generator)
    position, normal, axis = position[chosen], normal[chosen], axis[chosen, None]
    jitter = torch.rand(n_points, 3, generator=generator, dtype=torch.float64) - 0.5
    offset = jitter.scatter(1, axis, 0.0) * steps
    slope = _away_from_zero(normal.gather(1, axis))
    back = -(offset * normal).sum(1, keepdim=True) / slope  # along the edge, onto the tangent plane
    limit = steps[axis]
    offset.scatter_(1, axis, back.clamp(-limit, limit))
    return position + offset + steps.new_tensor(grid.origin), normal


def _away_from_zero(values: Tensor) -> Tensor:
    return torch.where(values.abs() < 1e-6, torch.full_like(values, 1e-6), values)


def _crossings(values: Tensor, axis: int, steps: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Crossings of the zero set with the grid edges along one axis: position, normal, axis, weight."""
    n = values.shape[axis]
    inside = values > 0
    index = (inside.narrow(axis, 0, n - 1) != inside.narrow(axis, 1, n - 1)).nonzero()  # (m, 3), lower ends
    upper = index.clone()
    upper[:, axis] += 1
    low, high = values[tuple(index.T)].double(), values[tuple(upper.T)].double()
    share = (low / (low - high)).clamp(0, 1).nan_to_num(0.5)  # between infinite values, half-way
    position = index.double()
    position[:, axis] += share
    slope = (1 - share)[:, None] * _slope(values, index, steps) + share[:, None] * _slope(values, upper, steps)
    slope[:, axis] = (high - low) / steps[axis]  # the exact difference along the crossed edge, which is never zero
    normal = -torch.nn.functional.normalize(slope.nan_to_num(0.0, 1e30, -1e30), dim=1)
    weight = normal[:, axis].abs() * (steps.prod() / steps[axis])
    return position * steps, normal, torch.full((len(index),), axis), weight


def _slope(values: Tensor, index: Tensor, steps: Tensor) -> Tensor:
    """Gradient at grid points by central differences, one-sided at the border."""
    parts = []
    for axis in range(3):
        before, after = index.clone(), index.clone()
        before[:, axis] = (before[:, axis] - 1).clamp(min=0)
        after[:, axis] = (after[:, axis] + 1).clamp(max=values.shape[axis] - 1)
        width = (after[:, axis] - before[:, axis]) * steps[axis]
        parts.append((values[tuple(after.T)].double() - values[tuple(before.T)].double()) / width)
    return torch.stack(parts, dim=-1)


def project(function: ValueAndGradient, starts: Tensor, normals: Tensor, reach: float) -> tuple[Tensor, Tensor]:
    """Move points to the zero set along the gradient, or along their normal where that fails.

    Newton's steps are −f ∇f/|∇f|², at most half of `reach` long. Points for which they do not converge within `reach`
    of their start are found by bisection along their normal, if the sign changes there.

    Args:
        function: maps (N, 3) to values (N,) and gradients (N, 3), both detached.
        starts: (N, 3), near the zero set.
        normals: (N, 3), unit, roughly across the zero set.
        reach: farthest distance from the start, in units of length.

    Returns:
        Points (N, 3), and (N,) bool: which of them are on the zero set, to rounding.
    """
    points, tolerance = starts.clone(), reach * _precision(starts.dtype)
    is_on = torch.zeros(len(starts), dtype=torch.bool, device=starts.device)
    for _ in range(_STEPS):
        rows = (~is_on).nonzero()[:, 0]
        if len(rows) == 0:
            break
        value, gradient = function(points[rows])
        square = gradient.square().sum(-1)
        usable = (square > 0) & square.isfinite() & value.isfinite()
        step = torch.where(usable, value / torch.where(usable, square, 1), 0)[:, None] * gradient.where(
            usable[:, None], torch.zeros_like(gradient)
        )
        length = step.norm(dim=-1, keepdim=True)
        points[rows] -= step * (reach / 2 / length.clamp(min=reach / 2))
        is_on[rows] = usable & (length[:, 0] <= tolerance)
    strayed = (points - starts).norm(dim=-1) > reach
    rows = (~is_on | strayed).nonzero()[:, 0]
    if len(rows):
        points[rows], is_on[rows] = _bisect(function, starts[rows], normals[rows], reach)
    return points, is_on


def follow(function: ValueAndGradient, starts: Tensor, reach: float) -> tuple[Tensor, Tensor]:
    """Starts (N, 3) moved onto the level set, and the normals by which they went, each (M, 3); M are near enough.

    Args:
        function: as for `project`.
        starts: (N, 3).
        reach: largest distance by which a start is moved.
    """
    _, gradient = function(starts)
    normals = outward_normals(gradient, starts.new_tensor((0.0, 0.0, 1.0)))
    points, is_on = project(function, starts, normals, reach)
    return points[is_on], normals[is_on]


def _precision(dtype: torch.dtype) -> float:
    """Length of the last Newton step, relative to `reach`, from which on a point counts as projected."""
    return max(4 * torch.finfo(dtype).eps, 1e-12) if dtype == torch.float64 else 64 * torch.finfo(dtype).eps


def _bisect(function: ValueAndGradient, starts: Tensor, normals: Tensor, reach: float) -> tuple[Tensor, Tensor]:
    """Zeros (N, 3) within `reach` of the starts along their normals, and (N,) bool: whether there is one."""
    low, high = starts - reach * normals, starts + reach * normals
    low_value, high_value = function(low)[0], function(high)[0]
    for _ in range(50):
        middle = (low + high) / 2
        value = function(middle)[0]
        to_high = (value > 0) == (high_value > 0)
        high = torch.where(to_high[:, None], middle, high)
        low = torch.where(to_high[:, None], low, middle)
    return (low + high) / 2, (low_value > 0) != (high_value > 0)


def edge_crossings(evaluate: Evaluate, low: Floats, high: Floats, low_value: Floats, high_value: Floats) -> Floats:
    """Where a field is zero on segments at whose ends it has opposite signs, by the Illinois method.

    Args:
        evaluate: maps (N, 3) float64 positions to values (N,).
        low: (N, 3), one end.
        high: (N, 3), the other end.
        low_value: (N,), the values at the first.
        high_value: (N,), the values at the second.

    Returns:
        (N,), shares of the way from low to high; within 0 … 1 whatever the field does in between.

    Reference:
        M. Dowell, P. Jarratt, "A modified regula falsi method", BIT 11, 1971, doi:10.1007/BF01934364.
    """
    begin, end = np.zeros(len(low)), np.ones(len(low))
    at_begin, at_end = low_value.copy(), high_value.copy()
    moved_end = np.zeros(len(low))  # 1 and −1: the end, or the beginning, was moved last
    share = at_begin / (at_begin - at_end)
    for _ in range(_CROSSING_STEPS):
        places = torch.from_numpy(low + share[:, None] * (high - low))
        value = torch.cat([evaluate(part).cpu().double() for part in places.split(_CHUNK)]).numpy()
        side = np.where((value > 0) == (at_end > 0), 1, -1)
        at_begin = np.where(side > 0, np.where(moved_end > 0, at_begin / 2, at_begin), value)
        at_end = np.where(side > 0, value, np.where(moved_end < 0, at_end / 2, at_end))
        begin, end, moved_end = np.where(side > 0, begin, share), np.where(side > 0, share, end), side
        secant = begin + (end - begin) * at_begin / (at_begin - at_end)
        share = np.where(np.isfinite(secant), secant, (begin + end) / 2)  # the field may be infinite in between
    return share


def implicit_point(value: Tensor, point: Tensor, gradient: Tensor) -> Tensor:
    """Points of a level set as functions of the field's value there: the implicit function theorem.

    When the field changes by df at a point of its level set, the level set moves by dp = −∇f df / |∇f|². The result has
    this derivative with respect to the value, from where autograd goes on to whatever the field was computed from. The
    motion of a point along its surface is not determined, and is zero.

    Args:
        value: (N,), the field at the points, zero up to rounding.
        point: (N, 3), taken as constant.
        gradient: (N, 3), ∇f, taken as constant; where it vanishes the point does not move.

    Returns:
        (N, 3), equal to `point` up to the distance that the value leaves.
    """
    gradient = gradient.detach()
    square = gradient.square().sum(-1, keepdim=True)
    direction = gradient / torch.where(square > 0, square, 1)
    return point.detach() - value[:, None] * direction


def outward_normals(gradient: Tensor, fallback: Tensor) -> Tensor:
    """Unit normals −∇F/|∇F| (N, 3); where the gradient vanishes, the fallback's, (N, 3) or (3,)."""
    flat = (gradient.detach() == 0).all(-1, keepdim=True)
    return torch.where(flat, fallback, normalize(torch.where(flat, fallback, -gradient)))
