"""The extinction of Gaussians on a grid: optical depth per unit of length, differentiable in the Gaussians.

A splat of opacity o absorbs −log(1 − o) along a ray through its center, straight through its disc, however thin the
disc is. As a density it is a Gaussian whose integral over space is that optical depth times the area of the disc.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from topokit.core.arrays import Floats, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.grid.grid import Grid

REACH = 3.0  # standard deviations: beyond, a Gaussian is cut off at 1 % of its value in the middle


def extinction(means: Tensor, covariances: Tensor, integrals: Tensor, grid: Grid) -> Tensor:
    """Σ aᵢ · N(x; μᵢ, Σᵢ) at the vertices of a grid, each Gaussian cut off at three standard deviations.

    Args:
        means: (N, 3), in units of length.
        covariances: (N, 3, 3), positive definite, in squared units. Gaussians that are thinner than a cell fall between
            the vertices: add the square of a cell to the diagonal.
        integrals: (N,), integral of each over space: optical depth times area.
        grid: where; its step along all axes is one cell.

    Returns:
        (X, Y, Z) float64 on the CPU, in 1 / length; differentiable in means, covariances and integrals, except where a
        vertex lies on the border of a Gaussian.
    """
    means, covariances, integrals = (part.double().cpu() for part in (means, covariances, integrals))
    heights = integrals / ((2 * math.pi) ** 3 * torch.linalg.det(covariances)).sqrt()
    reaches = REACH * covariances.detach().diagonal(dim1=1, dim2=2).sqrt()
    found: Tensor = _Sum.apply(means, torch.linalg.inv(covariances), heights, reaches, grid)
    return found


class _Sum(torch.autograd.Function):
    """Gaussians by their means (N, 3), inverse covariances (N, 3, 3) and heights (N,), summed on a grid."""

    @staticmethod
    def forward(context: Any, means: Tensor, inverse: Tensor, heights: Tensor, reaches: Tensor, grid: Grid) -> Tensor:
        steps = (means.detach().numpy() - np.array(grid.origin)) / grid.cell
        reach = reaches.numpy() / grid.cell
        low = np.maximum(np.ceil(steps - reach), 0).astype(np.int64)
        high = np.minimum(np.floor(steps + reach) + 1, grid.shape).astype(np.int64)
        forms = inverse.detach().numpy() * grid.cell**2
        context.save_for_backward(heights)
        context.found = steps, forms, low, high, grid.cell
        values = np.zeros(grid.shape)
        _add(steps, forms, heights.detach().numpy(), low, high, values)
        return torch.from_numpy(values)

    @staticmethod
    @once_differentiable
    def backward(context: Any, slope: Tensor) -> tuple[Tensor | None, ...]:
        steps, forms, low, high, cell = context.found
        [heights] = context.saved_tensors
        of_steps, of_forms, of_heights = np.zeros_like(steps), np.zeros_like(forms), np.zeros(len(steps))
        values = np.ascontiguousarray(slope.numpy())
        _add_back(steps, forms, heights.detach().numpy(), low, high, values, of_steps, of_forms, of_heights)
        of_means, of_inverse = torch.from_numpy(of_steps / cell), torch.from_numpy(of_forms * cell**2)
        return of_means, of_inverse, torch.from_numpy(of_heights), None, None


@compiled
def _add(steps: Floats, forms: Floats, heights: Floats, low: Integers, high: Integers, values: Floats) -> None:
    for splat in range(len(steps)):
        form = forms[splat]
        for x in range(low[splat, 0], high[splat, 0]):
            a = x - steps[splat, 0]
            for y in range(low[splat, 1], high[splat, 1]):
                b = y - steps[splat, 1]
                flat = form[0, 0] * a * a + form[1, 1] * b * b + 2 * form[0, 1] * a * b
                slope = 2 * (form[0, 2] * a + form[1, 2] * b)
                for z in range(low[splat, 2], high[splat, 2]):
                    c = z - steps[splat, 2]
                    power = flat + c * (slope + form[2, 2] * c)
                    if power < REACH * REACH:
                        values[x, y, z] += heights[splat] * math.exp(-power / 2)


@compiled
def _add_back(
    steps: Floats,
    forms: Floats,
    heights: Floats,
    low: Integers,
    high: Integers,
    slopes: Floats,
    of_steps: Floats,
    of_forms: Floats,
    of_heights: Floats,
) -> None:
    away = np.empty(3)
    for splat in range(len(steps)):
        form = forms[splat]
        for x in range(low[splat, 0], high[splat, 0]):
            away[0] = x - steps[splat, 0]
            for y in range(low[splat, 1], high[splat, 1]):
                away[1] = y - steps[splat, 1]
                for z in range(low[splat, 2], high[splat, 2]):
                    if slopes[x, y, z] == 0:
                        continue
                    away[2] = z - steps[splat, 2]
                    power = 0.0
                    for i in range(3):
                        for j in range(3):
                            power += form[i, j] * away[i] * away[j]
                    if power >= REACH * REACH:
                        continue
                    share = slopes[x, y, z] * math.exp(-power / 2)
                    of_heights[splat] += share
                    share *= heights[splat]
                    for i in range(3):
                        for j in range(3):
                            of_forms[splat, i, j] -= share * away[i] * away[j] / 2
                            of_steps[splat, i] += share * (form[i, j] + form[j, i]) * away[j] / 2
