"""Quadratic B-splines between scattered points and a regular grid: splatting, gathering, and their derivatives.

Gathering with the weights with which samples were splatted is the exact adjoint of splatting, and the analytic slope of
the weights gives the divergence of splatted vectors without a difference stencil.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.errors import InputError

_BLOCK = 1 << 16  # points whose 27 weights and slopes are held at once


@dataclass(frozen=True, eq=False)
class Grid:
    """A box of cubic cells whose vertices carry the values of a field.

    Attributes:
        origin: (3,), position of vertex (0, 0, 0).
        cell: edge length of one cell, in units of the points.
        shape: vertices along each axis.
    """

    origin: Tensor
    cell: float
    shape: tuple[int, int, int]


def make_grid(
    points: Tensor,
    spacing: float,
    cells_per_spacing: float = 2.0,
    maximum_vertices: int = 192**3,
    minimum_length: int = 64,
    margin: float = 0.12,
    margin_cells: int = 8,
) -> Grid:
    """A padded grid whose cell follows from the sample spacing.

    Args:
        points: (N, 3) sample positions.
        spacing: typical distance between neighboring samples, √(area / N).
        cells_per_spacing: cells that one spacing should span.
        maximum_vertices: the cell grows until the grid has at most this many vertices.
        minimum_length: the longest axis has about this many vertices at least.
        margin: padding on each side as a share of the longest side (Fourier space is periodic).
        margin_cells: padding on each side in cells, at least.

    Raises:
        InputError: if the points have no extent, are not finite, or the spacing is not positive.
    """
    if len(points) == 0 or not spacing > 0:
        raise InputError(f"a grid around {len(points)} points needs a positive spacing, not {spacing:g}.")
    low, high = points.detach().amin(0), points.detach().amax(0)
    extent = (high - low).double()
    longest = float(extent.max())
    if not math.isfinite(longest) or longest <= 0.0:
        raise InputError("the points are all in one place or not finite, so no grid can be laid around them.")
    cell = min(spacing / cells_per_spacing, longest / (minimum_length * 0.7))
    while True:
        pad = 2 * max(margin * longest, margin_cells * cell)
        x, y, z = (_fast_length(math.ceil((float(side) + pad) / cell) + 1) for side in extent)
        n_vertices = x * y * z
        if n_vertices <= maximum_vertices:
            break
        cell *= 1.02 * max(1.0, (n_vertices / maximum_vertices) ** (1 / 3) * 0.98)
    middle = (low + high).double() / 2
    size = torch.tensor([(n - 1) * cell for n in (x, y, z)], dtype=torch.float64, device=points.device)
    return Grid((middle - size / 2).to(points), cell, (x, y, z))


def _fast_length(length: int) -> int:
    """Smallest even number not below `length`, and not below 8, whose only prime factors are 2, 3 and 5."""
    candidate = max(8, length + (length % 2))
    while True:
        rest = candidate
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return candidate
        candidate += 2


@dataclass(frozen=True, eq=False)
class _Stencil:
    """Weights of n points on the grid: flat `index` (n, 27), `weight` (n, 27), `slope` (n, 27, 3) in 1/length."""

    index: Tensor
    weight: Tensor
    slope: Tensor


class GridSampler:
    """The two-way street between N points and a grid; differentiable in the points, in the values and in the field.

    Weights of few points are kept from call to call, those of many are recomputed block by block, so that without
    gradients the memory beyond points and grid is bounded.
    """

    def __init__(self, points: Tensor, grid: Grid) -> None:
        """Args: points (N, 3), any float dtype and device; grid around them (beyond it the outermost cells count)."""
        self.points = points
        self.grid = grid
        self._kept = _stencil(points, grid) if len(points) <= _BLOCK else None

    def splat(self, values: Tensor) -> Tensor:
        """Σᵢ vᵢ φ(x − pᵢ): values (N,) → field of the grid's shape. Adjoint of `gather`."""
        flat = self._empty(values)
        for rows, stencil in self._blocks():
            share = stencil.weight * values[rows, None]
            flat.index_add_(0, stencil.index.reshape(-1), share.reshape(-1))
        return flat.reshape(self.grid.shape)

    def splat_dipoles(self, dipoles: Tensor) -> Tensor:
        """Σᵢ dᵢ · ∇ₚ φ(x − pᵢ), minus the divergence of the splatted vectors (N, 3). Adjoint of `gather_gradient`."""
        flat = self._empty(dipoles)
        for rows, stencil in self._blocks():
            share = torch.einsum("nkc,nc->nk", stencil.slope, dipoles[rows])
            flat.index_add_(0, stencil.index.reshape(-1), share.reshape(-1))
        return flat.reshape(self.grid.shape)

    def gather(self, field: Tensor) -> Tensor:
        """The interpolated field at the points, (N,)."""
        flat = field.reshape(-1)
        return torch.cat([(flat[stencil.index] * stencil.weight).sum(1) for _, stencil in self._blocks()])

    def gather_gradient(self, field: Tensor) -> Tensor:
        """The gradient of the interpolated field at the points, (N, 3), per unit of length."""
        flat = field.reshape(-1)
        parts = [torch.einsum("nk,nkc->nc", flat[stencil.index], stencil.slope) for _, stencil in self._blocks()]
        return torch.cat(parts)

    def _empty(self, values: Tensor) -> Tensor:
        return torch.zeros(math.prod(self.grid.shape), dtype=values.dtype, device=values.device)

    def _blocks(self) -> Iterator[tuple[slice, _Stencil]]:
        for start in range(0, max(len(self.points), 1), _BLOCK):
            rows = slice(start, start + _BLOCK)
            yield rows, self._kept or _stencil(self.points[rows], self.grid)


def _stencil(points: Tensor, grid: Grid) -> _Stencil:
    position = (points - grid.origin) / grid.cell
    nearest = position.detach().round()
    offset = position - nearest  # in [−1/2, 1/2]
    limit = torch.tensor(grid.shape, device=points.device) - 2
    base = torch.minimum(nearest.long().clamp_min(1), limit)
    weight = torch.stack((0.5 * (0.5 - offset) ** 2, 0.75 - offset**2, 0.5 * (0.5 + offset) ** 2), dim=1)  # (n, 3, 3)
    slope = torch.stack((offset - 0.5, -2.0 * offset, offset + 0.5), dim=1) / grid.cell
    wx, wy, wz = weight.unbind(2)  # (n, 3 nodes) each
    sx, sy, sz = slope.unbind(2)
    step = torch.arange(-1, 2, device=points.device)
    ix, iy, iz = (base[:, axis, None] + step for axis in range(3))
    index = (ix[:, :, None, None] * grid.shape[1] + iy[:, None, :, None]) * grid.shape[2] + iz[:, None, None, :]
    slopes = torch.stack((_product(sx, wy, wz), _product(wx, sy, wz), _product(wx, wy, sz)), dim=2)
    return _Stencil(index.reshape(-1, 27), _product(wx, wy, wz), slopes)


def _product(first: Tensor, second: Tensor, third: Tensor) -> Tensor:
    """Outer product of three (n, 3) as (n, 27)."""
    return (first[:, :, None, None] * second[:, None, :, None] * third[:, None, None, :]).reshape(len(first), 27)
