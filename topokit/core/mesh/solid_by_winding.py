"""The solid enclosed by a triangle mesh, clean or not, by its winding number."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.core.grid.euler import surface_euler
from topokit.core.grid.grid import make_grid
from topokit.core.grid.winding_field import winding_field
from topokit.core.mesh.sampling import sample_triangles

_SAMPLES = 50_000
_LARGEST_GRID = 128**3


@dataclass(frozen=True)
class EnclosedSolid:
    """The region where the mesh's winding number exceeds one half.

    Attributes:
        euler: Euler characteristic of its surface.
        off_level: share of the mesh's area that is not on the surface of that region, because it lies inside, overlaps
            other parts, or bounds walls thinner than the grid.
        cell: grid step, in units of the vertices.
    """

    euler: int
    off_level: float
    cell: float


def enclosed_solid(vertices: Tensor, faces: Tensor) -> EnclosedSolid:
    """Sample a mesh densely and threshold the winding-number field of the samples.

    Unlike V − E + F this works with holes, loose triangles, duplicated and intersecting parts, as long as the faces are
    oriented; features smaller than two grid steps are lost.

    Args:
        vertices: (V, 3).
        faces: (F, 3) int64.

    Raises:
        InputError: if the mesh has no area or no extent.

    Reference:
        Jacobson et al. 2013, DOI 10.1145/2461912.2461916 (generalized winding numbers); the field is that of
        `winding_field`.
    """
    vertices, faces = vertices.detach().cpu().double(), faces.cpu()
    center, unit = _frame(vertices[faces])
    vertices = (vertices - center) / unit
    corners = vertices[faces]
    samples, _ = sample_triangles(vertices, faces, _SAMPLES)
    cross = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], dim=-1)
    area = float(cross.norm(dim=-1).sum()) / 2 / _SAMPLES
    points = samples.points.float()
    normals = (samples.normals if samples.normals is not None else points).float()
    grid = make_grid(points, area**0.5, 1.0, _LARGEST_GRID)
    field = winding_field(points, normals, torch.full_like(points[:, 0], area), grid)
    off_level = ((field.sample(points) - 0.5).abs() > 0.3).double().mean()
    return EnclosedSolid(int(surface_euler(field.values, 0.5, connectivity=6)), float(off_level), grid.cell * unit)


def _frame(corners: Tensor) -> tuple[Tensor, float]:
    """The center of the box around corners (F, 3, 3), and the power of two above its largest side: the unit in which
    no coordinate leaves the range of single precision."""
    low, high = corners.amin((0, 1)), corners.amax((0, 1))
    return low / 2 + high / 2, math.ldexp(1.0, math.frexp(float((high - low).max()))[1])
