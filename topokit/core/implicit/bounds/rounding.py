"""How large the rounding errors of double precision are, at most: what makes bounds proofs.

Sums of n products, in any order and with or without fused operations, differ from the exact sum by at most
γ_n Σ|a_i b_i| with γ_n = n u / (1 − n u) and u = 2⁻⁵³ (Higham, Accuracy and Stability of Numerical Algorithms, Section
3.1). `gamma` is eight times that, so that sums of a few such errors, themselves rounded, are covered.

Functions such as tanh are not rounded correctly by torch. They are taken to be within 2⁻⁴⁶ (1 + |value|), 64 units in
the last place and more than 10 times what its libraries promise; a test compares them with 40 digits.
"""

from __future__ import annotations

import torch
from torch import Tensor

STEP = 2.0**-50  # eight units: more than a few operations one after the other
TINY = 1e-290  # products below the smallest number are lost: an absolute error far below this
FUNCTION = 2.0**-46


def gamma(n_terms: int) -> float:
    """A bound of the relative error of a sum of so many products, and of a few more operations."""
    return (n_terms + 8) * STEP


def widened(radius: Tensor, size: Tensor | float, relative: float = STEP) -> Tensor:
    """A radius that covers errors of this relative size in numbers of this magnitude, and its own rounding."""
    return radius * (1 + 2 * relative) + relative * size + TINY


def from_function(lowest: Tensor, highest: Tensor) -> tuple[Tensor, Tensor]:
    """Bounds of values that torch's functions have computed, with their errors."""
    return lowest - FUNCTION * (1 + lowest.abs()), highest + FUNCTION * (1 + highest.abs())


def up(values: Tensor) -> Tensor:
    """Non-negative sums of a few numbers, rounded up."""
    return values * (1 + STEP) + TINY


def constant(value: object) -> Tensor:
    """A number or tensor of the function as float64: what is stored is taken as exact."""
    if isinstance(value, Tensor):
        return value.detach().to("cpu", torch.float64)
    return torch.as_tensor(value, dtype=torch.float64)
