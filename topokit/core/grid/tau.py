"""The scale τ of the levels over which the smoothed Euler characteristic is averaged."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from topokit.core.grid.euler import at_least_single

SMALLEST_TAU = 1e-30  # slopes go with 1 / τ, and single precision has to hold them


def default_tau(values: Tensor) -> float:
    """The default of τ everywhere: half the typical change of a field (X, Y, Z), level subtracted, over one cell."""
    return max(0.5 * typical_step(values), SMALLEST_TAU)


def typical_step(values: Tensor) -> float:
    """The median change over one cell where the field (X, Y, Z) crosses zero, where it does.

    A field that has left its level, as happens in training, has a typical change all the same: the mean of its changes,
    and if it is constant its distance from the level, or 1.
    """
    steps = _finite_steps(values, lambda lower, upper: (lower > 0) != (upper > 0))
    if len(steps):
        return float(steps.median())
    steps = _finite_steps(values, torch.ne)
    if len(steps):
        return float(steps.mean())
    return float(values.abs().where(values.isfinite(), 0).amax()) or 1.0


def _finite_steps(values: Tensor, counts: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    """|F(b) − F(a)| over the grid edges ab that count, where it is finite."""
    steps = []
    for axis in range(3):
        n = values.shape[axis]
        lower, upper = values.narrow(axis, 0, n - 1), values.narrow(axis, 1, n - 1)
        chosen = counts(lower, upper)
        steps.append((at_least_single(upper[chosen]) - at_least_single(lower[chosen])).abs())
    found = torch.cat(steps)
    return found[found.isfinite()]
