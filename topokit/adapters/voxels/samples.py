"""Samples of a volume's surface for curvature: the level set of the volume smoothed over one voxel."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from topokit.core.implicit.level_set import area_weighted_starts, project
from topokit.core.linalg import normalize
from topokit.core.samples import SurfaceSamples

_SIGMA = 1.0  # voxels; takes the staircase out of a binary volume
_MARGIN = 4  # voxels of background around the solid, for the filter
_STEP = 1e-3  # voxels; for differences of the cubic spline


def volume_samples(
    values: Tensor,
    spacing: tuple[float, float, float],
    origin: tuple[float, float, float],
    n_samples: int,
    generator: torch.Generator,
) -> SurfaceSamples:
    """Area-weighted points with outward normals on the smoothed level set, at their places in the volume.

    Solids so thin that smoothing makes them vanish are sampled as they are.

    Args:
        values: (X, Y, Z), positive inside, with at least one voxel inside.
        spacing: size of a voxel along each axis.
        origin: position of the first voxel's centre.
        n_samples: number of samples.
        generator: source of randomness on the CPU.
    """
    grid, first = _cropped(values)
    smooth = ndimage.gaussian_filter(grid, _SIGMA, mode="nearest")
    shape_is_kept = 2 * (smooth > 0).sum() >= (grid > 0).sum() > 0
    starts, normals = area_weighted_starts(
        torch.from_numpy(smooth if shape_is_kept else grid), n_samples, spacing, generator
    )
    if shape_is_kept:
        surface = _Spline(smooth, spacing)
        points, is_on = project(surface.value_and_gradient, starts, normals, 2 * max(spacing))
        slope = surface.value_and_gradient(points)[1]
        starts = torch.where(is_on[:, None], points, starts)
        normals = torch.where(is_on[:, None], normalize(-slope), normals)
    corner = starts.new_tensor(origin) + starts.new_tensor(first) * starts.new_tensor(spacing)
    return SurfaceSamples(starts + corner, normals)


def _cropped(values: Tensor) -> tuple[NDArray[np.float32], list[int]]:
    """The box around the solid with a margin, and the index of its first voxel; −∞ becomes the lowest finite value."""
    inside = (values > 0).cpu()
    low, high = [], []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        occupied = inside.any(others[1]).any(others[0]).nonzero()[:, 0]
        low.append(int(occupied[0]))
        high.append(int(occupied[-1]) + 1)
    begin = [max(0, start - _MARGIN) for start in low]
    end = [min(n, stop + _MARGIN) for n, stop in zip(values.shape, high, strict=True)]
    part = values[begin[0] : end[0], begin[1] : end[1], begin[2] : end[2]].float().cpu().numpy()
    finite = part[np.isfinite(part)]
    bottom, top = (float(finite.min()), float(finite.max())) if finite.size else (-1.0, 1.0)
    bottom = min(bottom, -top) if bottom >= 0 else bottom
    top = top if top > 0 else -bottom
    part = np.nan_to_num(part, nan=bottom, posinf=top, neginf=bottom)
    before = [_MARGIN - (start - b) for start, b in zip(low, begin, strict=True)]
    after = [_MARGIN - (e - stop) for stop, e in zip(high, end, strict=True)]
    padded = np.pad(part, list(zip(before, after, strict=True)), constant_values=bottom)
    return padded, [b - pad for b, pad in zip(begin, before, strict=True)]


class _Spline:
    """Cubic spline through the values of a grid, with its gradient by differences."""

    def __init__(self, values: NDArray[np.float32], spacing: tuple[float, float, float]) -> None:
        self.coefficients = ndimage.spline_filter(values, output=np.float32)
        self.spacing = np.asarray(spacing)

    def value_and_gradient(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Values (N,) and gradients (N, 3) at positions (N, 3)."""
        places = points.numpy() / self.spacing
        slopes = []
        for axis in range(3):
            shift = _STEP * np.eye(3)[axis]
            change = self._at(places + shift) - self._at(places - shift)
            slopes.append(change / (2 * _STEP * self.spacing[axis]))
        return torch.from_numpy(self._at(places)), torch.from_numpy(np.stack(slopes, axis=1))

    def _at(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        found = ndimage.map_coordinates(
            self.coefficients, places.T, output=np.float64, order=3, prefilter=False, mode="nearest"
        )
        return np.asarray(found)
