"""Samples of a volume's surface: points on the level set of the smoothed volume."""

from __future__ import annotations

import torch
from torch import Tensor

from topokit.core.grid.euler import at_least_single
from topokit.core.grid.filters import gaussian, spline_coefficients
from topokit.core.grid.grid import Grid, Spacing, occupied_box
from topokit.core.grid.scaling import at_moderate_size
from topokit.core.grid.splines import GridSampler
from topokit.core.implicit.level_set import area_weighted_starts, follow, implicit_point, outward_normals, project
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError

_SIGMA = 1.0  # voxels; removes the staircase of a binary volume
_MARGIN = 4  # voxels of background around the solid, for the filter
_REACH = 2.0  # largest steps of the grid by which a start is moved onto the surface


def volume_samples(
    values: Tensor, grid: Grid, n_samples: int, generator: torch.Generator, starts: Tensor | None = None
) -> SurfaceSamples:
    """Area-weighted points with outward normals on the level set of the volume smoothed over one voxel.

    Where smoothing makes the solid vanish, since it is thin, or what is around it, since values there are far smaller,
    the volume is sampled as it is.

    Args:
        values: (X, Y, Z), positive inside, with at least one voxel inside.
        grid: of the voxels' centers.
        n_samples: number of samples.
        generator: source of randomness on the CPU.
        starts: (N, 3), from which samples are found instead of from a draw; None for the draw.

    Returns:
        Samples on the CPU, differentiable in the values by the implicit function theorem: at a fixed choice of samples,
        each of which moves along its normal. Those that do not reach the level set stay where they were drawn.

    Raises:
        InputError: if there are starts, and none of them is near the level set.
    """
    field, first = _field(values)
    x, y, z = field.shape
    surface = _QuadraticSpline(field, grid.spacing)
    corner = torch.tensor(grid.origin, dtype=torch.float64) + torch.tensor(first) * surface.spacing
    reach = _REACH * grid.step
    if starts is None:
        points, normals = area_weighted_starts(field.detach(), Grid((x, y, z), grid.spacing), n_samples, generator)
        found, is_on = project(surface.detached, points, normals, reach)
        points = torch.where(is_on[:, None], found, points)
    else:
        points, normals = follow(surface.detached, starts.detach().to(corner) - corner, reach)
        is_on = torch.ones(len(points), dtype=torch.bool)
        if len(points) == 0:
            raise InputError(
                f"none of the {len(starts)} starts is within {reach:.3g} of the volume's surface: leave starts out, so "
                "that samples are drawn."
            )
    value, gradient = surface(points)
    moved = implicit_point(value, points, gradient * is_on[:, None])
    normals = torch.where(is_on[:, None], outward_normals(surface(moved)[1], normals), normals)
    return SurfaceSamples(moved + corner, normals)


class _QuadraticSpline:
    """The quadratic spline through the values of a grid whose first vertex is at the origin."""

    def __init__(self, values: Tensor, spacing: Spacing) -> None:
        x, y, z = values.shape
        self._coefficients = spline_coefficients(values)
        self._grid = Grid((x, y, z))
        self.spacing = torch.tensor(spacing, dtype=torch.float64)

    def __call__(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Values (N,) and gradients (N, 3) at positions (N, 3), differentiable in these and the grid's values."""
        sampler = GridSampler(points / self.spacing, self._grid)
        return sampler.gather(self._coefficients), sampler.gather_gradient(self._coefficients) / self.spacing

    @torch.no_grad()
    def detached(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """The same without a graph."""
        return self(points)


def _field(values: Tensor) -> tuple[Tensor, list[int]]:
    """What is sampled: the box around the solid with a margin, smoothed if it survives; the index of its first voxel.

    The surroundings of the volume, and what stands for infinite values, are constants.
    """
    sharp, first = _crop(values)
    smooth = gaussian(sharp, _SIGMA)
    before, after = int((sharp > 0).count_nonzero()), int((smooth > 0).count_nonzero())
    survives = 2 * after >= before and 2 * (smooth.numel() - after) >= sharp.numel() - before
    return smooth if survives else sharp, first


def _crop(values: Tensor) -> tuple[Tensor, list[int]]:
    """The box around the solid with a margin, in units of the median value, and the index of its first voxel."""
    box = occupied_box(values > 0)
    first = [start - _MARGIN for start, _ in box]
    last = [stop + _MARGIN for _, stop in box]
    part = at_least_single(values[tuple(slice(max(0, a), b) for a, b in zip(first, last, strict=True))].cpu())
    finite = part.detach()[part.isfinite()]
    size = float(finite.abs().amax()) if len(finite) else 0.0
    low, high = (float(end) for end in finite.aminmax()) if size else (0.0, 0.0)
    bottom, top = min(low, 0.0) or -(size or 1.0), max(high, 0.0) or size or 1.0
    missing = [(max(0, -a), max(0, b - n)) for a, b, n in zip(first, last, values.shape, strict=True)]
    around = [count for pair in reversed(missing) for count in pair]
    finite_part = torch.nan_to_num(part, nan=bottom, posinf=top, neginf=bottom)
    return at_moderate_size(torch.nn.functional.pad(finite_part, around, value=bottom)), first
