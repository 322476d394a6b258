"""Samples regularized by their own winding number, with a grid and a smoothing that follow from spacing and noise."""

from __future__ import annotations

import math

from torch import Tensor

from topokit.core.grid.grid import make_grid
from topokit.core.grid.winding_field import regularize
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError

_CELLS_PER_SPACING = 2.0  # so that two sheets two spacings apart stay apart
_SHARE = 0.25  # standard deviation of the smoothing, as a share of the radius of a neighborhood


def regularized_samples(samples: SurfaceSamples, areas: Tensor, n_neighbors: int) -> SurfaceSamples:
    """Samples moved onto the surface where their winding number is one half, with normals from its gradient.

    The smoothing follows the number of neighbors that the noise calls for: a quarter of the radius of a disc that holds
    so many samples.

    Args:
        samples: (N, 3), with outward normals.
        areas: (N,), the area that each sample stands for.
        n_neighbors: see `topokit.core.local.neighborhood_size.automatic_neighbors`.

    Returns:
        As many samples with outward normals, differentiable in the points and normals given, at a fixed grid.

    Raises:
        InputError: if the samples are batched, or have no outward normals.
    """
    normals = samples.known_normals()
    if samples.points.ndim != 2 or normals is None or not samples.oriented:
        raise InputError(
            "a winding number needs one cloud (N, 3) with outward normals: use shape.oriented(), and an item at a time."
        )
    spacing = float(areas.detach().mean().sqrt())
    grid = make_grid(samples.points, spacing, _CELLS_PER_SPACING)
    sigma = _SHARE * math.sqrt(n_neighbors / math.pi) * spacing / grid.cell
    return SurfaceSamples(*regularize(samples.points, normals, areas, grid, sigma))
