"""Area-weighted samples of triangles, differentiable in the vertices."""

from __future__ import annotations

import torch
from torch import Tensor

from topokit.core.draws import stratified_draw
from topokit.core.linalg import normalize
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError


def sample_triangles(
    vertices: Tensor, faces: Tensor, n_samples: int, generator: torch.Generator | None = None
) -> tuple[SurfaceSamples, Tensor]:
    """Points spread over a mesh in proportion to area.

    The area is cut into `n_samples` equal shares in face order and one point is drawn in each, so every place is
    equally likely and large faces are covered more evenly than by independent draws.

    Args:
        vertices: (V, 3), floating point.
        faces: (F, 3) int64, oriented outward.
        n_samples: number of points.
        generator: source of randomness on the CPU; seed 0 if None.

    Returns:
        Samples with face normals, and the face (N,) each lies on. Positions and normals are differentiable in the
        vertices at a fixed choice of faces and barycentric coordinates.

    Raises:
        InputError: if the mesh has no area.
    """
    generator = generator or torch.Generator().manual_seed(0)
    face = stratified_draw(_relative_areas(vertices, faces), n_samples, generator)
    root, along = torch.rand(2, n_samples, generator=generator, dtype=torch.float64)
    root = root.sqrt()  # without the square root the points crowd at a corner
    weights = torch.stack((root * (1 - along), root * along), dim=-1).to(vertices)
    face = face.to(vertices.device)
    origin, second, third = vertices[faces[face]].unbind(1)
    second, third = second - origin, third - origin
    points = origin + (weights[:, :1] * second + weights[:, 1:] * third)
    normals = torch.linalg.cross(normalize(second), normalize(third), dim=-1)
    return SurfaceSamples(points, normalize(normals)), face


def _relative_areas(vertices: Tensor, faces: Tensor) -> Tensor:
    """Areas (F,) on the CPU in float64, up to a common factor that keeps those of tiny meshes from vanishing."""
    corners = vertices.detach()[faces].double().cpu()
    corners = corners - corners[:1, :1]
    corners = corners / corners.abs().max().clamp(min=torch.finfo(torch.float64).tiny)
    areas = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], dim=-1).norm(dim=-1)
    if not bool(areas.sum() > 0):
        raise InputError("the mesh has no area: all of its faces are degenerate, so it cannot be sampled.")
    return areas
