"""Points on a level set: starts from the grid, Newton projection, and the implicit function theorem."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from topokit.core.implicit.adaptive_grid import FieldGrid

ValueAndGradient = Callable[[Tensor], tuple[Tensor, Tensor]]
_STEPS = 40


def area_weighted_starts(
    values: Tensor, n_points: int, spacing: tuple[float, float, float], generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Points near the zero set of a field on a grid, spread in proportion to area.

    The zero set crosses grid edges at the vertices of marching cubes. Of the crossings along one axis each stands for
    a patch whose shadow along that axis is one face of the grid; weighted with that face times |n_axis|, the sum over
    the three axes is unbiased, because n_x² + n_y² + n_z² = 1. A start is a crossing moved at random over its face.

    Args:
        values: (X, Y, Z), with a change of sign.
        n_points: number of starts.
        spacing: step along each axis.
        generator: source of randomness on the CPU.

    Returns:
        Starts (n, 3) relative to the first grid point, in units of length, float64, and unit normals (n, 3) at the
        crossings towards lower values, from differences on the grid.
    """
    steps = torch.tensor(spacing, dtype=torch.float64)
    found = [_crossings(values, axis, steps) for axis in range(3)]
    position, normal, axis, weight = (torch.cat(column) for column in zip(*found, strict=True))
    reached = weight.cumsum(0)
    share = (torch.arange(n_points) + torch.rand(n_points, generator=generator, dtype=torch.float64)) / n_points
    chosen = torch.searchsorted(reached, share * reached[-1]).clamp(max=len(reached) - 1)
    jitter = torch.rand(n_points, 3, generator=generator, dtype=torch.float64) - 0.5
    jitter.scatter_(1, axis[chosen, None], 0.0)
    offset = jitter * steps
    along = -(offset * normal[chosen]).sum(1) / _component(normal, axis)[chosen]  # back onto the tangent plane
    limit = steps[axis[chosen]]
    offset.scatter_(1, axis[chosen, None], along.clamp(-limit, limit)[:, None])
    return position[chosen] + offset, normal[chosen]


def _component(vectors: Tensor, axis: Tensor) -> Tensor:
    """One component of each vector, kept away from zero."""
    part = vectors.gather(1, axis[:, None])[:, 0]
    return torch.where(part.abs() < 1e-6, torch.full_like(part, 1e-6), part)


def _crossings(values: Tensor, axis: int, steps: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Crossings of the zero set with the grid edges along one axis: position, normal, axis, weight."""
    n = values.shape[axis]
    inside = values > 0
    index = (inside.narrow(axis, 0, n - 1) != inside.narrow(axis, 1, n - 1)).nonzero()  # (m, 3), lower ends
    upper = index.clone()
    upper[:, axis] += 1
    low, high = values[tuple(index.T)].double(), values[tuple(upper.T)].double()
    share = (low / (low - high)).clamp(0, 1).nan_to_num(0.5)  # infinite values meet half-way
    position = index.double()
    position[:, axis] += share
    slope = (1 - share)[:, None] * _slope(values, index, steps) + share[:, None] * _slope(values, upper, steps)
    slope[:, axis] = (high - low) / steps[axis]  # the edge itself knows best, and is never flat
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
    """Move points along straight lines or the gradient to the zero set.

    Newton's step −f ∇f/|∇f|², at most half of `reach` long; points that it does not settle within `reach` of their
    start are found by bisection along their normal, if the sign changes there.

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
            return points, is_on
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


def _precision(dtype: torch.dtype) -> float:
    return max(4 * torch.finfo(dtype).eps, 1e-12) if dtype == torch.float64 else 64 * torch.finfo(dtype).eps


def _bisect(function: ValueAndGradient, starts: Tensor, normals: Tensor, reach: float) -> tuple[Tensor, Tensor]:
    low, high = starts - reach * normals, starts + reach * normals
    low_value, high_value = function(low)[0], function(high)[0]
    for _ in range(50):
        middle = (low + high) / 2
        value = function(middle)[0]
        to_high = (value > 0) == (high_value > 0)
        high = torch.where(to_high[:, None], middle, high)
        low = torch.where(to_high[:, None], low, middle)
    return (low + high) / 2, (low_value > 0) != (high_value > 0)


class ImplicitPoint(torch.autograd.Function):
    """A point of a level set as a function of the field's value there: the implicit function theorem.

    When the field changes by df at a point of its level set, the level set moves by dp = −∇f df / |∇f|². Forward takes
    the value (zero up to rounding once projected), the point and the gradient, and gives the point; backward hands
    −(∇f · dL/dp) / |∇f|² to the value, from where autograd goes on to whatever the field was computed from. Points
    and gradients are constants here: the motion of a point along its surface is not determined, and is zero.
    """

    @staticmethod
    def forward(ctx: Any, value: Tensor, point: Tensor, gradient: Tensor) -> Tensor:
        """(N,), (N, 3), (N, 3) → (N, 3)."""
        direction = gradient / gradient.square().sum(-1, keepdim=True)
        ctx.save_for_backward(direction)
        return point - value[:, None] * direction

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor, None, None]:
        """dL/dp (N, 3) → dL/df (N,)."""
        (direction,) = ctx.saved_tensors
        return -(grad_outputs[0] * direction).sum(-1), None, None


def implicit_curvature(gradient: Tensor, hessian: Tensor) -> tuple[Tensor, Tensor]:
    """Gaussian and mean curvature of the level sets of a field that grows outward.

    K = ∇fᵀ adj(Hf) ∇f / |∇f|⁴,  2H = (|∇f|² tr Hf − ∇fᵀ Hf ∇f) / |∇f|³.

    Args:
        gradient: ∇f, (N, 3).
        hessian: Hf, (N, 3, 3).

    Returns:
        K (N,) in 1/length² and H (N,) in 1/length; a sphere of radius r has K = 1/r², H = 1/r.

    Reference:
        R. Goldman, "Curvature formulas for implicit curves and surfaces", CAGD 22, 2005,
        doi:10.1016/j.cagd.2005.06.005.
    """
    first, second, third = hessian.unbind(-2)
    adjugate = torch.stack(
        (
            torch.linalg.cross(second, third, dim=-1),
            torch.linalg.cross(third, first, dim=-1),
            torch.linalg.cross(first, second, dim=-1),
        ),
        dim=-2,
    )  # of a symmetric matrix
    square = gradient.square().sum(-1)

    def form(matrix: Tensor) -> Tensor:
        return (gradient.unsqueeze(-2) @ matrix @ gradient.unsqueeze(-1))[..., 0, 0]

    trace = hessian.diagonal(dim1=-2, dim2=-1).sum(-1)
    return form(adjugate) / square.square(), (square * trace - form(hessian)) / (2 * square**1.5)


def grid_starts(grid: FieldGrid, n_points: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """`area_weighted_starts` of a `FieldGrid`, as positions in its frame."""
    starts, normals = area_weighted_starts(grid.values, n_points, grid.spacing, generator)
    return starts + starts.new_tensor(grid.origin), normals
