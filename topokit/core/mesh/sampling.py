"""Area-weighted samples of triangles, differentiable in the vertices."""

from __future__ import annotations

import torch
from torch import Tensor

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
    corners = vertices[faces]  # (F, 3, 3)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    scaled = corners.detach().double().cpu()
    scaled = scaled - scaled[:1, :1]
    scaled = scaled / scaled.abs().max().clamp(min=torch.finfo(torch.float64).tiny)
    cross = torch.linalg.cross(scaled[:, 1] - scaled[:, 0], scaled[:, 2] - scaled[:, 0], dim=-1)
    reached = cross.norm(dim=-1).cumsum(0)
    if not bool(reached[-1] > 0):
        raise InputError("the mesh has no area: all of its faces are degenerate, so it cannot be sampled.")
    share = (torch.arange(n_samples) + torch.rand(n_samples, generator=generator, dtype=torch.float64)) / n_samples
    face = torch.searchsorted(reached, share * reached[-1]).clamp(max=len(faces) - 1)
    root, along = torch.rand(2, n_samples, generator=generator, dtype=torch.float64)
    root = root.sqrt()  # without the square root the points crowd at a corner
    weights = torch.stack((root * (1 - along), root * along), dim=-1).to(vertices)
    face = face.to(vertices.device)
    step = weights[:, :1] * first[face] + weights[:, 1:] * second[face]
    normals = torch.linalg.cross(normalize(first[face]), normalize(second[face]), dim=-1)
    return SurfaceSamples(corners[face, 0] + step, normalize(normals)), face
