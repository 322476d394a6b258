"""Solids as fields on a grid over [−1, 1]³, positive inside, and what marching cubes finds in them."""

from __future__ import annotations

from functools import reduce

import numpy as np
import torch
import trimesh
from skimage.measure import marching_cubes
from torch import Tensor

Center = tuple[float, float, float]
ORIGIN = (0.0, 0.0, 0.0)


def grid(n: int) -> Tensor:
    """(n, n, n, 3) positions, float64."""
    axis = torch.linspace(-1, 1, n, dtype=torch.float64)
    return torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), dim=-1)


def ball(p: Tensor, radius: float, center: Center = ORIGIN) -> Tensor:
    return radius - (p - p.new_tensor(center)).norm(dim=-1)


def torus(p: Tensor, major: float, minor: float, center: Center = ORIGIN) -> Tensor:
    """Around the z axis."""
    q = p - p.new_tensor(center)
    return minor - torch.hypot(q[..., :2].norm(dim=-1) - major, q[..., 2])


def rod(p: Tensor, radius: float, half: float, axis: int = 2, center: Center = ORIGIN) -> Tensor:
    """A cylinder along an axis."""
    q = p - p.new_tensor(center)
    across = q[..., [k for k in range(3) if k != axis]].norm(dim=-1)
    return torch.minimum(radius - across, half - q[..., axis].abs())


def block(p: Tensor, halves: Center, center: Center = ORIGIN) -> Tensor:
    return (p.new_tensor(halves) - (p - p.new_tensor(center)).abs()).amin(dim=-1)


def union(*fields: Tensor) -> Tensor:
    return reduce(torch.maximum, fields)


def without(field: Tensor, *holes: Tensor) -> Tensor:
    return reduce(lambda rest, hole: torch.minimum(rest, -hole), holes, field)


def meshed_topology(field: Tensor | np.ndarray) -> tuple[int, int]:
    """Connected surfaces and V − E + F of marching cubes on the field, background added around it."""
    padded = np.pad(np.asarray(torch.as_tensor(field).detach(), dtype=float), 1, constant_values=-1.0)
    vertices, faces, _, _ = marching_cubes(padded, 0.0)
    mesh = trimesh.Trimesh(vertices, faces)
    assert mesh.is_watertight
    return mesh.body_count, mesh.euler_number
