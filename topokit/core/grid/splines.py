"""Quadratic B-spline interpolation on a regular grid (`gather`), its adjoint (`splat`), and the derivatives of both.

Both use the same weights, so each is the exact adjoint of the other; the analytic slope of the weights gives the
divergence of splatted vectors without finite differences.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from topokit.core.grid.grid import Grid
from topokit.core.precision import full_precision

_BLOCK = 1 << 16  # points whose 27 weights and slopes are held at once


@dataclass(frozen=True, eq=False)
class _Stencil:
    """The 27 grid vertices around each of n points, and the splines' values there.

    Attributes:
        index: (n, 27), flat index of the vertices.
        axis_weight: per axis (n, 3), the spline's value at the three vertices along it.
        axis_slope: the same for its derivative, in 1/length.
    """

    index: Tensor
    axis_weight: tuple[Tensor, ...]
    axis_slope: tuple[Tensor, ...]

    @cached_property
    def weight(self) -> Tensor:
        """(n, 27), the splines' values."""
        return _product(*self.axis_weight)

    @cached_property
    def slope(self) -> Tensor:
        """(n, 27, 3), their gradients in 1/length."""
        (wx, wy, wz), (sx, sy, sz) = self.axis_weight, self.axis_slope
        return torch.stack((_product(sx, wy, wz), _product(wx, sy, wz), _product(wx, wy, sz)), dim=2)

    def complete(self) -> _Stencil:
        """Compute all values now, with or without gradients as now, and not when they are first used."""
        _ = self.weight, self.slope
        return self


class GridSampler:
    """B-spline interpolation between N points and a grid; differentiable in the points, the values and the field.

    The weights of few points are kept between calls, those of many are recomputed block by block. So the memory beyond
    points and grid is bounded where no gradients are needed.
    """

    def __init__(self, points: Tensor, grid: Grid) -> None:
        """Args: points (N, 3), any float dtype and device; grid: of cubes, around the points."""
        self.points = points
        self.grid = grid
        self._kept = _stencil(points, grid).complete() if len(points) <= _BLOCK else None

    def splat(self, values: Tensor) -> Tensor:
        """Σᵢ vᵢ φ(x − pᵢ): values (N,) → field of the grid's shape. Adjoint of `gather`."""
        flat = self._empty(values)
        for rows, stencil in self._blocks():
            share = stencil.weight * values[rows, None]
            flat.index_add_(0, stencil.index.reshape(-1), share.reshape(-1))
        return flat.reshape(self.grid.shape)

    @full_precision
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

    @full_precision
    def gather_gradient(self, field: Tensor) -> Tensor:
        """The gradient of the interpolated field at the points, (N, 3), per unit of length."""
        flat = field.reshape(-1)
        parts = []
        for _, stencil in self._blocks():
            parts.append(torch.einsum("nk,nkc->nc", flat[stencil.index].to(stencil.slope.dtype), stencil.slope))
        return torch.cat(parts)

    def _empty(self, values: Tensor) -> Tensor:
        return torch.zeros(self.grid.n_vertices, dtype=values.dtype, device=values.device)

    def _blocks(self) -> Iterator[tuple[slice, _Stencil]]:
        for start in range(0, max(len(self.points), 1), _BLOCK):
            rows = slice(start, start + _BLOCK)
            yield rows, self._kept or _stencil(self.points[rows], self.grid)


def _stencil(points: Tensor, grid: Grid) -> _Stencil:
    along = zip(points.unbind(1), grid.origin, strict=True)
    position = torch.stack([coordinate - start for coordinate, start in along], dim=1) / grid.cell
    nearest = position.detach().round()
    offset = position - nearest  # in [−1/2, 1/2]
    base = [vertex.clamp(1, size - 2) for vertex, size in zip(nearest.long().unbind(1), grid.shape, strict=True)]
    weight = torch.stack((0.5 * (0.5 - offset) ** 2, 0.75 - offset**2, 0.5 * (0.5 + offset) ** 2), dim=1)  # (n, 3, 3)
    slope = torch.stack((offset - 0.5, -2.0 * offset, offset + 0.5), dim=1) / grid.cell
    step = torch.arange(-1, 2, device=points.device)
    ix, iy, iz = (vertex[:, None] + step for vertex in base)
    index = (ix[:, :, None, None] * grid.shape[1] + iy[:, None, :, None]) * grid.shape[2] + iz[:, None, None, :]
    return _Stencil(index.reshape(-1, 27), weight.unbind(2), slope.unbind(2))


def _product(first: Tensor, second: Tensor, third: Tensor) -> Tensor:
    """Outer product of three (n, 3) as (n, 27)."""
    return (first[:, :, None, None] * second[:, None, :, None] * third[:, None, None, :]).reshape(len(first), 27)
