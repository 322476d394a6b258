"""Random draws of samples: stratified by weight, from a seed that is fixed before they are made."""

from __future__ import annotations

import torch
from torch import Tensor

from topokit.errors import InputError, Option


def deferred_seed(generator: torch.Generator | None) -> int:
    """A seed for draws that are made later, so that they do not depend on when that is.

    Args:
        generator: source of randomness, advanced by one int64; None stands for seed 0.

    Returns:
        What to seed a new generator with when the draws are made: `torch.Generator().manual_seed(seed)`.
    """
    if generator is None:
        return 0
    return int(torch.randint(torch.iinfo(torch.int64).max, (), generator=generator, device=generator.device))


def stratified_draw(weights: Tensor, n_draws: int, generator: torch.Generator) -> Tensor:
    """Indices drawn in proportion to weight, one from each of `n_draws` equal shares of the total.

    Args:
        weights: (M,) not negative, with a positive sum; on the CPU.
        n_draws: number of draws.
        generator: source of randomness on the CPU; one float64 is taken per draw.

    Returns:
        (n_draws,) int64, ascending. Every unit of weight is equally likely, and large weights are covered more evenly
        than by independent draws.
    """
    reached = weights.cumsum(0)
    share = (torch.arange(n_draws) + torch.rand(n_draws, generator=generator, dtype=torch.float64)) / n_draws
    return torch.searchsorted(reached, share * reached[-1]).clamp(max=len(weights) - 1)


def check_sample_count(n_samples: int, n_neighbors: int) -> None:
    """Check that every sample can have its neighbors.

    Raises:
        InputError: if there are not more samples than neighbors.
    """
    if n_samples <= n_neighbors:
        larger = f" is {n_samples}; it must be larger than ", Option("n_neighbors"), f", which is {n_neighbors}."
        raise InputError(Option("n_samples"), *larger)
