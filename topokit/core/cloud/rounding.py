"""Coordinates that single precision has rounded: far from the origin its numbers are far apart."""

from __future__ import annotations

import math

import torch
from torch import Tensor


@torch.no_grad()
def single_precision_step(points: Tensor) -> float:
    """Distance between neighboring single-precision numbers at the largest coordinate of points (N, 3).

    It is 0 if the coordinates have more digits than that, so that they never were in single precision.
    """
    largest = float(points.abs().max())
    if largest == 0 or not torch.equal(points.float().to(points.dtype), points):
        return 0.0
    return math.ldexp(torch.finfo(torch.float32).eps, math.frexp(largest)[1] - 1)
