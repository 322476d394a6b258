"""The winding-number field of oriented surface samples on a regular grid.

Oriented samples are a dipole layer. Their winding number w(q) = Σ Aᵢ nᵢ·(pᵢ − q) / (4π|pᵢ − q|³) is one inside, zero
outside, and solves Δw = −div Σ Aᵢ nᵢ δ(x − pᵢ). On a padded grid this takes one real Fourier transform, a diagonal
filter and the inverse transform. Everything here is differentiable in points, normals and areas. Normals point outward.

References:
    M. Kazhdan, M. Bolitho, H. Hoppe, "Poisson surface reconstruction", SGP 2006, doi:10.2312/SGP/SGP06/061-070.
    G. Barill, N. G. Dickson, R. Schmidt, D. I. W. Levin, A. Jacobson, "Fast winding numbers for soups and clouds", ACM
    TOG 37(4), 2018, doi:10.1145/3197517.3201337.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.core.grid.grid import Grid, make_grid
from topokit.core.grid.splines import GridSampler
from topokit.core.linalg import normalize
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError

_CELLS_PER_SPACING = 2.0  # so that two sheets two spacings apart stay apart
_SHARE = 0.25  # standard deviation of the smoothing, as a share of the radius of a neighborhood


class PoissonFilter:
    """Inverse of minus the Laplacian on a periodic grid, smoothed by a Gaussian: exp(−σ²k²/2) / k² in Fourier space.

    Symmetric; the mean of the result is zero. The input is a sum of splatted samples, which becomes a density by
    division by the cell's volume.
    """

    def __init__(self, grid: Grid, sigma: float, like: Tensor) -> None:
        """Args: grid: of cubes; sigma: standard deviation of the Gaussian in cells; like: gives dtype and device."""
        self._shape = grid.shape
        self._cell = grid.cell
        axes = [torch.fft.fftfreq(n, dtype=like.dtype, device=like.device) for n in grid.shape[:2]]
        axes.append(torch.fft.rfftfreq(grid.shape[2], dtype=like.dtype, device=like.device))
        self._squares = [(2 * math.pi * axis) ** 2 for axis in axes]  # of wave numbers per cell
        squared = self._squares[0][:, None, None] + (self._squares[1][:, None] + self._squares[2])
        squared[0, 0, 0].fill_(torch.inf)  # the mean becomes zero
        self._inverse = squared.reciprocal_()
        self.smooth(sigma)

    def smooth(self, sigma: float) -> None:
        """Set another Gaussian, of standard deviation `sigma` in cells; 1/k² is kept."""
        x, y, z = (torch.exp(-0.5 * sigma**2 * square) for square in self._squares)  # the Gaussian is separable
        # a density has cell⁻³ and a dimensional k has cell⁻¹: together 1 / cell
        self._multiplier = (self._inverse * (x / self._cell)[:, None, None]).mul_(y[:, None] * z)

    def __call__(self, density: Tensor) -> Tensor:
        """Filter a field of the grid's shape."""
        return torch.fft.irfftn(torch.fft.rfftn(density) * self._multiplier, s=self._shape)


@dataclass(frozen=True, eq=False)
class WindingField:
    """Winding numbers on the vertices of a grid, shifted so that the samples lie on one half on average.

    Attributes:
        values: field of shape `grid.shape`; about 1 inside, about 0 outside.
        grid: its geometry.
    """

    values: Tensor
    grid: Grid

    def sample(self, points: Tensor) -> Tensor:
        """The field at points (N, 3), as (N,); differentiable in the points and in what the field was made from."""
        return GridSampler(points, self.grid).gather(self.values)

    def gradient(self, points: Tensor) -> Tensor:
        """The field's gradient at points (N, 3), as (N, 3) in 1/length; on the surface it points inward."""
        return GridSampler(points, self.grid).gather_gradient(self.values)


def winding_field(points: Tensor, normals: Tensor, areas: Tensor, grid: Grid, sigma: float = 1.5) -> WindingField:
    """The winding-number field of oriented samples, smoothed over `sigma` cells.

    Args:
        points: (N, 3), any float dtype and device.
        normals: (N, 3), unit, outward.
        areas: (N,), surface area that each sample stands for.
        grid: around the points with a margin, see `make_grid`.
        sigma: Gaussian smoothing in cells.

    Returns:
        The field; {w > ½} is the solid. Differentiable in points, normals and areas.

    Raises:
        InputError: if the shapes do not fit.
    """
    _check(points, normals, areas)
    sampler = GridSampler(points, grid)
    values = -PoissonFilter(grid, sigma, points)(sampler.splat_dipoles(normals * areas[:, None]))
    shift = 0.5 - (sampler.gather(values) * areas).sum() / areas.sum()
    return WindingField(values + shift, grid)


def regularize(
    points: Tensor, normals: Tensor, areas: Tensor, grid: Grid, sigma: float = 1.5, steps: int = 2
) -> tuple[Tensor, Tensor]:
    """Move samples onto {w = ½} and take their normals from the field (the paper's winding-number regularization).

    Args:
        points: (N, 3).
        normals: (N, 3), unit, outward.
        areas: (N,).
        grid: as for `winding_field`.
        sigma: Gaussian smoothing in cells; more removes more noise.
        steps: Newton steps, each at most as long as the smoothing length.

    Returns:
        Points (N, 3) and outward unit normals (N, 3), those given where the field is flat. Differentiable.

    Raises:
        InputError: if the shapes do not fit.
    """
    field = winding_field(points, normals, areas, grid, sigma)
    longest = max(sigma, 1.0) * grid.cell
    for _ in range(steps):
        sampler = GridSampler(points, grid)
        gradient = sampler.gather_gradient(field.values)
        squared = gradient.square().sum(1, keepdim=True).clamp_min((1e-6 / grid.cell) ** 2)
        move = (0.5 - sampler.gather(field.values))[:, None] * gradient / squared
        points = points + move * (longest / move.norm(dim=1, keepdim=True).clamp_min(longest))
    gradient = field.gradient(points)
    is_flat = gradient.detach().norm(dim=1, keepdim=True) * grid.cell <= 1e-9
    return points, torch.where(is_flat, normals, -normalize(gradient))


def _check(points: Tensor, normals: Tensor, areas: Tensor) -> None:
    if points.dim() != 2 or points.shape[1] != 3 or normals.shape != points.shape or areas.shape != points.shape[:1]:
        raise InputError(
            "a winding number needs points (N, 3), normals (N, 3) and areas (N,), "
            f"not {tuple(points.shape)}, {tuple(normals.shape)} and {tuple(areas.shape)}."
        )


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
