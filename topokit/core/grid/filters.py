"""Linear filters of volumes by SciPy, differentiable: a Gaussian, and the coefficients of an interpolating spline."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import torch
from scipy import ndimage
from torch import Tensor

Filter = Callable[..., Any]


def gaussian(values: Tensor, sigma: float) -> Tensor:
    """A volume (X, Y, Z) on the CPU smoothed by a Gaussian of `sigma` voxels, in its own type; differentiable.

    Every side must be longer than 4 `sigma`. Beyond its borders the volume is mirrored.
    """
    smooth: Tensor = _Mirrored.apply(values, partial(ndimage.gaussian_filter, sigma=sigma, mode="mirror"))
    return smooth


def spline_coefficients(values: Tensor) -> Tensor:
    """Coefficients of the quadratic spline through a volume (X, Y, Z) on the CPU, in its own type; differentiable.

    Beyond its borders the volume is mirrored.
    """
    coefficients: Tensor = _Mirrored.apply(values, partial(ndimage.spline_filter, order=2, mode="mirror"))
    return coefficients


class _Mirrored(torch.autograd.Function):
    """A symmetric filter of a volume that is mirrored at the centers of its outermost voxels.

    Of each mirrored pair of voxels one is in the volume, of the outermost ones both halves are the same. So the filter
    F is its own adjoint if these count one half, W F = Fᵀ W, and its derivatives of all orders are filters again.
    """

    @staticmethod
    def forward(values: Tensor, filtered: Filter) -> Tensor:
        array = values.detach().numpy()
        return torch.from_numpy(filtered(array, output=array.dtype))

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Tensor, Filter], output: Tensor) -> None:
        ctx.filter = inputs[1]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        adjoint: Tensor = _Mirrored.apply(_outermost_times(gradients[0], 2.0), ctx.filter)
        return _outermost_times(adjoint, 0.5), None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor, _: None) -> Tensor:
        moved: Tensor = _Mirrored.apply(tangent, ctx.filter)
        return moved


def _outermost_times(values: Tensor, factor: float) -> Tensor:
    """A copy in which the first and last layer along each axis are multiplied by a factor."""
    values = values.clone()
    for axis in range(3):
        for end in (0, -1):
            values.select(axis, end).mul_(factor)
    return values
