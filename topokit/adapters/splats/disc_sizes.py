"""Gaussians as discs: thickness, area and sampling weight."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torch import Tensor

from topokit.errors import InputError

if TYPE_CHECKING:
    from topokit.adapters.splats.gaussians import GaussianSplats


def thickness(splats: GaussianSplats) -> Tensor:
    """Smallest over middle scale, (N,), 0 for a disc and 1 for a ball or a needle; detached."""
    ordered = splats.scales.detach().sort(dim=-1).values
    return ordered[:, 0] / ordered[:, 1]


def disc_areas(splats: GaussianSplats) -> Tensor:
    """Product of the two larger scales, (N,), in float64, where products of float32 cannot overflow; detached."""
    ordered = splats.scales.detach().double().sort(dim=-1).values
    return ordered[:, 1] * ordered[:, 2]


def disc_weights(splats: GaussianSplats) -> Tensor:
    """Area times opacity as shares of the whole, (N,), float64; detached.

    Raises:
        InputError: if every splat is fully transparent.
    """
    areas = disc_areas(splats)
    weights = areas / areas.max() * splats.opacities.detach()
    if not bool(weights.sum() > 0):
        raise InputError(f"all {len(splats)} splats have opacity 0: there is no surface to sample.")
    return weights / weights.sum()
