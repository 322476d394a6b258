"""Dipole vectors at samples whose winding number is one half there: orientation without normals.

References:
    S. Lin, Z. Shi, Y. Liu, "Fast and globally consistent normal orientation based on the winding number normal
    consistency", ACM TOG 43(6), 2024, doi:10.1145/3687895.
"""

from __future__ import annotations

import torch
from torch import Tensor

from topokit.core.arrays import Floats
from topokit.core.grid.grid import make_grid
from topokit.core.grid.splines import GridSampler
from topokit.core.grid.winding_field import PoissonFilter

_LEAST_CURVATURE = 1e-30  # of the energy along a direction of descent; below it single precision is exhausted


def border_mean(field: Tensor) -> Tensor:
    """Mean of a field (X, Y, Z) over the six faces of its box."""
    faces = [field.select(axis, end).mean() for axis in range(3) for end in (0, -1)]
    return torch.stack(faces).sum() / 6


class DipoleSolver:
    """The linear map from dipole vectors to winding numbers on one grid, and two ways to invert it at the samples."""

    def __init__(self, points: Floats | Tensor, areas: Floats | Tensor, cell: float) -> None:
        """Args: points (N, 3), on any device; areas (N,); cell: desired edge length of the grid's cells."""
        self.points = torch.as_tensor(points, dtype=torch.float32)
        areas_ = torch.as_tensor(areas, dtype=torch.float32)
        self.areas = areas_ / areas_.mean()
        self.grid = make_grid(self.points, cell, 1.0, 160**3, minimum_length=16)
        self.sampler = GridSampler(self.points, self.grid)
        self.solve = PoissonFilter(self.grid, 1.0, self.points)

    def field(self, dipoles: Tensor) -> Tensor:
        """Winding numbers on the grid, zero on average over the box's faces."""
        field = -self.solve(self.sampler.splat_dipoles(dipoles))
        return field - border_mean(field)

    def adjoint(self, values: Tensor) -> Tensor:
        """The adjoint of `field` followed by interpolation: values at the samples (N,) → dipole vectors (N, 3)."""
        return -self.sampler.gather_gradient(self.solve(self.sampler.splat(values)))

    def conjugate_gradients(self, sigma: float, iterations: int, damping: float = 1e-2) -> Tensor:
        """Dipoles (N, 3) of least weighted norm with w(pᵢ) ≈ ½, by damped conjugate gradients."""
        self.solve.smooth(sigma)
        root = self.areas.sqrt()[:, None]
        solution = torch.zeros_like(self.points)
        residual = root * self.adjoint(torch.full_like(self.areas, 0.5))
        direction, size, scale = residual.clone(), (residual * residual).sum(), None
        for _ in range(iterations):
            image = root * self.adjoint(self.sampler.gather(self.field(root * direction)))
            if scale is None:
                scale = damping * (direction * image).sum() / size.clamp_min(1e-30)
            image = image + scale * direction
            along = (direction * image).sum()
            goes_on = along > _LEAST_CURVATURE  # on lattices nothing is left to solve after a few steps
            length = torch.where(goes_on, size / along, 0)
            solution, residual = solution + length * direction, residual - length * image
            new = (residual * residual).sum()
            direction = torch.where(goes_on, residual + new / size.clamp_min(1e-30) * direction, 0)
            size = new
        return root * solution

    def alternate(self, dipoles: Tensor, first_sigma: float, last_sigma: float, iterations: int) -> Tensor:
        """Alternates a descent step on |w(p) − ½|² with turning every dipole along −∇w; σ falls geometrically."""
        for step in range(iterations):
            self.solve.smooth(first_sigma * (last_sigma / first_sigma) ** (step / max(iterations - 1, 1)))
            field = self.field(dipoles)
            residual = 0.5 - self.sampler.gather(field)
            descent = self.adjoint(residual) * self.areas[:, None]
            change = self.field(descent)
            image = self.sampler.gather(change)
            length = (residual * image).sum() / (image * image).sum().clamp_min(1e-30)
            dipoles, field = dipoles + length * descent, field + length * change
            outward = -self.sampler.gather_gradient(field)
            turned = outward / outward.norm(dim=1, keepdim=True).clamp_min(1e-12)
            dipoles = dipoles.norm(dim=1, keepdim=True) * turned
        return dipoles
