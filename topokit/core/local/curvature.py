"""Curvatures of surface samples: the local half of the method, from neighbours to principal directions."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.core.chunks import in_chunks
from topokit.core.linalg import determinant, eigenvalues, eigenvectors, squared_norm, trace
from topokit.core.local.frames import frames_from_neighbors, frames_from_normals
from topokit.core.local.voronoi import AreaMethod, cell_areas
from topokit.core.local.weingarten import Solver, weingarten_map
from topokit.core.neighbors import merged_neighbors, nearest_neighbors
from topokit.core.samples import SurfaceSamples

DEFAULT_NEIGHBORS = 20


@dataclass(frozen=True)
class CurvatureSettings:
    """How curvature and area are estimated from a neighborhood.

    Attributes:
        n_neighbors: k, number of nearest neighbors; more smooths more.
        solver: least-squares method for the Weingarten map, see `weingarten_map`.
        area_method: Voronoi cells "exact" or by "monte-carlo", see `cell_areas`; unused where the samples bring areas.
        area_resolution: points per side of the Monte Carlo grid.
    """

    n_neighbors: int = DEFAULT_NEIGHBORS
    solver: Solver = "sylvester"
    area_method: AreaMethod = "exact"
    area_resolution: int = 32


DEFAULT_SETTINGS = CurvatureSettings()


@dataclass(frozen=True, eq=False)
class Curvature:
    """Local geometry of N samples; every tensor but the two index-like ones is differentiable.

    Attributes:
        gaussian: K, (..., N), in 1/length².
        mean: H, (..., N), in 1/length; positive where the surface bends towards its inside (sphere of radius r: 1/r).
            Its sign is that of the normals and means nothing where those are not oriented.
        total: tr(WᵀW) = κ₁² + κ₂², (..., N).
        principal: (..., N, 2), κ_min then κ_max.
        directions: (..., N, 2, 3), unit vectors belonging to `principal`; signs are arbitrary, and at umbilics any
            tangent basis is right.
        area: (..., N), tangent Voronoi areas (or the samples' own).
        normals: (..., N, 3), unit.
        is_boundary: (..., N) bool, the surface ends beside this point.
        neighbors: (..., N, k) int64, nearest first; indices of each batch item's own points.
    """

    gaussian: Tensor
    mean: Tensor
    total: Tensor
    principal: Tensor
    directions: Tensor
    area: Tensor
    normals: Tensor
    is_boundary: Tensor
    neighbors: Tensor


def surface_curvature(
    samples: SurfaceSamples, settings: CurvatureSettings = DEFAULT_SETTINGS, *, neighbors: Tensor | None = None
) -> Curvature:
    """Curvature and area element at every sample (Algorithm 2, steps 2 to 6).

    Neighbours that stand at more than 45° over the tangent plane are left out: they lie on another sheet. The paper
    keeps them; on thin parts that halves the area.

    Args:
        samples: N points, with normals or frames if they are known.
        settings: number of neighbors and methods.
        neighbors: (..., N, k) indices from an earlier call; they are searched otherwise.

    Returns:
        `Curvature`, differentiable in points, normals, frames and areas. Neighbour indices are fixed: where a step
        changes them the value jumps.

    Raises:
        InputError: if there are too few points.
    """
    if neighbors is None:
        neighbors = nearest_neighbors(samples.points, settings.n_neighbors)
    flat, merged = samples.flat(), merged_neighbors(neighbors)
    frames = _frames(flat, merged)

    def local(rows: Tensor) -> tuple[Tensor, ...]:
        index = merged[rows]  # (m, k)
        basis = frames[rows, :2]  # (m, 2, 3)
        normal = frames[rows, 2].unsqueeze(-2)  # (m, 1, 3)
        offsets = flat.points[index] - flat.points[rows].unsqueeze(-2)  # (m, k, 3)
        tangent = offsets @ basis.mT  # (m, k, 2)
        around = frames[:, 2][index]  # (m, k, 3)
        if not samples.oriented:
            around = torch.where(around @ normal.mT < 0, -around, around)
        height = (offsets @ normal.mT).detach()
        same_sheet = height.square() <= squared_norm(tangent.detach()).unsqueeze(-1)
        tangent = tangent * same_sheet  # a neighbour moved to the centre takes part in nothing
        normal_change = (around - normal) @ basis.mT * same_sheet
        shape_operator = weingarten_map(tangent, normal_change, settings.solver)
        areas, is_open = cell_areas(tangent, settings.area_method, settings.area_resolution)
        return shape_operator, areas, is_open

    shape_operator, areas, is_open = in_chunks(local, len(merged), merged.device)
    symmetric = (shape_operator + shape_operator.mT) / 2  # as it is already, but for the commuting solver
    lead = samples.points.shape[:-1]
    return Curvature(
        gaussian=determinant(shape_operator).reshape(lead),
        mean=trace(shape_operator).reshape(lead) / 2,
        total=shape_operator.square().sum((-2, -1)).reshape(lead),
        principal=eigenvalues(symmetric).reshape(*lead, 2),
        directions=(eigenvectors(symmetric) @ frames[:, :2]).reshape(*lead, 2, 3),
        area=areas.reshape(lead) if samples.areas is None else samples.areas,
        normals=frames[:, 2].reshape(*lead, 3),
        is_boundary=is_open.reshape(lead),
        neighbors=neighbors,
    )


def _frames(flat: SurfaceSamples, neighbors: Tensor) -> Tensor:
    """Frames (B·N, 3, 3) from whatever the samples bring: frames, normals, or points alone."""
    if flat.frames is not None:
        return flat.frames

    def local(rows: Tensor) -> tuple[Tensor]:
        offsets = flat.points[neighbors[rows]] - flat.points[rows].unsqueeze(-2)
        if flat.normals is None:
            return (frames_from_neighbors(offsets),)
        return (frames_from_normals(flat.normals[rows], offsets),)

    return in_chunks(local, len(neighbors), neighbors.device)[0]
