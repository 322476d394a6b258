"""What a scene of splats absorbs: the optical depth of each, and on a grid the least one from outside."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from topokit.adapters.splats.disc_sizes import thickness
from topokit.adapters.splats.normals import rotation_matrices
from topokit.core.components import Corner
from topokit.core.grid.grid import Spacing
from topokit.core.opacity.scene import depth_around
from topokit.core.opacity.solid import Gaussians
from topokit.errors import InputError

if TYPE_CHECKING:
    from topokit.adapters.splats.gaussians import GaussianSplats

_FULLEST = 0.99  # opacity from which a splat lets nothing through, as renderers of 3DGS have it
_FLAT = 0.5  # smallest over middle scale, up to which a splat is a disc


@dataclass(frozen=True, eq=False)
class OpticalDepth:
    """How much light is absorbed on the clearest path from outside to each place.

    Attributes:
        values: (X, Y, Z) float64 on the CPU, in units of −log(transmittance): 0 outside, log 2 where half of the light
            is left. Differentiable in means, scales, rotations and opacities, at fixed paths.
        spacing: step of the grid along each axis, in units of the means.
        origin: position of the first value.
    """

    values: Tensor
    spacing: Spacing
    origin: Corner


def gaussians_of(splats: GaussianSplats) -> Gaussians:
    """The splats as Gaussians that absorb light, differentiable in them."""
    axes = rotation_matrices(splats.quaternions) * splats.scales.unsqueeze(-2)
    wide = splats.scales.sort(dim=-1, descending=True).values[:, :2].prod(-1)
    depths = -torch.log1p(-splats.opacities.clamp(max=_FULLEST))
    return Gaussians(splats.means, axes @ axes.mT, depths * 2 * math.pi * wide, thickness(splats) <= _FLAT)


def optical_depth(splats: GaussianSplats, step: float | None = None) -> OpticalDepth:
    """The least optical depth from outside on a grid around the splats; see `GaussianSplats.optical_depth`."""
    if len(splats) < 2:
        raise InputError(f"there are {len(splats)} splats; a scene of at least two was expected.")
    if step is not None and not 0 < step < math.inf:
        raise InputError(f"step is {step!r}; a positive length in units of the means was expected.")
    depth, grid = depth_around(gaussians_of(splats), step)
    return OpticalDepth(depth, grid.spacing, grid.origin)
