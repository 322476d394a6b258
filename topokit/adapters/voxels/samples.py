"""Samples of a volume's surface: points on the level set of the smoothed volume."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from topokit.core.grid.components import occupied_box
from topokit.core.grid.grid import Grid, Spacing
from topokit.core.grid.scaling import in_single_precision
from topokit.core.grid.splines import GridSampler
from topokit.core.implicit.level_set import area_weighted_starts, project
from topokit.core.linalg import normalize
from topokit.core.samples import SurfaceSamples

_SIGMA = 1.0  # voxels; removes the staircase of a binary volume
_MARGIN = 4  # voxels of background around the solid, for the filter


def volume_samples(values: Tensor, grid: Grid, n_samples: int, generator: torch.Generator) -> SurfaceSamples:
    """Area-weighted points with outward normals on the level set of the volume smoothed over one voxel.

    Where smoothing makes the solid vanish, since it is thin, or what is around it, since values there are far smaller,
    the volume is sampled as it is.

    Args:
        values: (X, Y, Z), positive inside, with at least one voxel inside.
        grid: of the voxels' centers.
        n_samples: number of samples.
        generator: source of randomness on the CPU.
    """
    sharp, first = _crop(values)
    smooth = ndimage.gaussian_filter(sharp, _SIGMA, mode="nearest")
    before, after = np.count_nonzero(sharp > 0), np.count_nonzero(smooth > 0)
    survives = 2 * after >= before and 2 * (smooth.size - after) >= sharp.size - before
    x, y, z = sharp.shape
    cropped = torch.from_numpy(smooth if survives else sharp)
    starts, normals = area_weighted_starts(cropped, Grid((x, y, z), grid.spacing), n_samples, generator)
    if survives:
        surface = _QuadraticSpline(smooth, grid.spacing)
        points, is_on = project(surface.value_and_gradient, starts, normals, 2 * grid.step)
        slope = surface.value_and_gradient(points)[1]
        starts = torch.where(is_on[:, None], points, starts)
        normals = torch.where(is_on[:, None], normalize(-slope), normals)
    corner = starts.new_tensor(grid.origin) + starts.new_tensor(first) * starts.new_tensor(grid.spacing)
    return SurfaceSamples(starts + corner, normals)


class _QuadraticSpline:
    """The quadratic spline through the values of a grid whose first vertex is at the origin."""

    def __init__(self, values: NDArray[np.float32], spacing: Spacing) -> None:
        x, y, z = values.shape
        self._coefficients = torch.from_numpy(ndimage.spline_filter(values, order=2, output=np.float32))
        self._grid = Grid((x, y, z))
        self._spacing = torch.tensor(spacing, dtype=torch.float64)

    def value_and_gradient(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Values (N,) and gradients (N, 3) at positions (N, 3)."""
        sampler = GridSampler(points / self._spacing, self._grid)
        return sampler.gather(self._coefficients), sampler.gather_gradient(self._coefficients) / self._spacing


def _crop(values: Tensor) -> tuple[NDArray[np.float32], list[int]]:
    """The box around the solid with a margin, in units of the median value, and the index of its first voxel."""
    box = occupied_box(values > 0)
    first = [start - _MARGIN for start, _ in box]
    last = [stop + _MARGIN for _, stop in box]
    cut = values[tuple(slice(max(0, a), b) for a, b in zip(first, last, strict=True))].cpu()
    part: NDArray[np.floating[Any]] = (cut if cut.dtype == torch.float64 else cut.float()).numpy()
    finite = part[np.isfinite(part)]
    size = float(np.abs(finite).max(initial=0.0)) or 1.0
    bottom, top = float(finite.min(initial=0.0)) or -size, float(finite.max(initial=0.0)) or size
    part = np.nan_to_num(part, nan=bottom, posinf=top, neginf=bottom)
    missing = [(max(0, -a), max(0, b - n)) for a, b, n in zip(first, last, values.shape, strict=True)]
    return in_single_precision(np.pad(part, missing, constant_values=bottom)), first
