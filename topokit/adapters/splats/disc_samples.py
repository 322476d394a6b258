"""Samples on the discs of Gaussians, differentiable in means, scales and quaternions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.adapters.splats.disc_sizes import disc_weights
from topokit.adapters.splats.gaussians import GaussianSplats
from topokit.adapters.splats.normals import axes_by_scale, right_handed
from topokit.core.draws import stratified_draw

REACH = 1.0  # standard deviations: discs of this radius overlap in a trained scene without leaving the surface
NEAR = 0.25  # the same for single samples, which stay as evenly spread as their splats


@dataclass(frozen=True)
class DiscSamples:
    """M points on discs.

    Attributes:
        points: (M, 3), differentiable.
        frames: (M, 3, 3), rows t, t', n, right-handed, differentiable; n is the axis of the smallest scale, whose
            sign is unknown, t that of the largest.
        splat: (M,) int64, the splat that each sample lies on.
    """

    points: Tensor
    frames: Tensor
    splat: Tensor


def sample_discs(
    splats: GaussianSplats, n_samples: int | None = None, generator: torch.Generator | None = None
) -> DiscSamples:
    """One point near the mean of every splat, or points spread over the discs in proportion to area times opacity.

    Several points on one disc leave gaps between the discs that look like holes of the surface. For a number of points,
    splats are drawn stratified by weight in file order. Positions are uniform on the ellipse of a quarter of a standard
    deviation around the mean, or of one.

    Args:
        splats: N splats with finite rows, positive weight and unit quaternions.
        n_samples: number of points M; None for one on every splat.
        generator: source of randomness (CPU); seed 0 if None.

    Returns:
        `DiscSamples` on the splats' device. Points and frames are differentiable in the splats at a fixed choice of
        splats and positions on their discs.
    """
    generator = generator or torch.Generator().manual_seed(0)
    if n_samples is None:
        splat, reach = torch.arange(len(splats)), NEAR
    else:
        splat, reach = stratified_draw(disc_weights(splats).cpu(), n_samples, generator), REACH
    splat = splat.to(splats.means.device)
    radius, angle = torch.rand(2, len(splat), generator=generator, dtype=torch.float64)
    radius, angle = reach * radius.sqrt(), 2 * math.pi * angle  # without the square root the points crowd the center
    position = torch.stack((radius * angle.cos(), radius * angle.sin()), dim=-1).to(splats.means)  # (M, 2)
    scales, axes = axes_by_scale(splats.scales, splats.quaternions)
    offsets = (position * scales[splat, :2]).unsqueeze(-2) @ axes[splat, :2]  # (M, 1, 3)
    return DiscSamples(splats.means[splat] + offsets.squeeze(-2), right_handed(axes)[splat], splat)
