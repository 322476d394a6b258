"""Fields of moderate size, whatever the size of their values."""

from __future__ import annotations

import math

import torch
from torch import Tensor

_RANGE = 1e30  # squares of its ends do not leave double precision, sums and differences not single precision


def at_moderate_size(values: Tensor) -> Tensor:
    """Finite values times the power of two that brings their median size to about 1; each keeps its sign.

    Sizes beyond 10³⁰ or below 10⁻³⁰ become that. The level set of zero stays where it is.

    Args:
        values: float32 or float64, any shape, on the CPU.

    Returns:
        The same type and shape; differentiable at a fixed power of two.
    """
    sizes = values.detach().abs()
    above = sizes[sizes > 0]
    exponent = math.frexp(float(above.median()))[1] if len(above) else 0
    half = exponent // 2
    scaled = values * 2.0**-half * 2.0 ** (half - exponent)  # one factor alone may leave the type
    sizes = scaled.detach().abs()
    is_moderate = ((sizes >= 1 / _RANGE) & (sizes <= _RANGE)) | (values == 0)
    return torch.where(is_moderate, scaled, sizes.clamp(1 / _RANGE, _RANGE).copysign(values.detach()))
