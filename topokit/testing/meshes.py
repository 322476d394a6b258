"""Triangle meshes of known genus, as (vertices (V, 3), faces (F, 3)) arrays, oriented outward."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from topokit.errors import InputError

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]


def icosphere(subdivisions: int = 3, radius: float = 1.0) -> Mesh:
    """A sphere: an icosahedron whose faces are split in four, `subdivisions` times."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


def torus_mesh(n_around: int = 60, n_tube: int = 30, major: float = 1.0, minor: float = 0.4) -> Mesh:
    """A torus around the z axis, χ = 0."""
    around, tube = np.meshgrid(np.arange(n_around), np.arange(n_tube), indexing="ij")
    u, v = tube.ravel() * 2 * math.pi / n_tube, around.ravel() * 2 * math.pi / n_around
    distance = major + minor * np.cos(u)
    vertices = np.stack((distance * np.cos(v), distance * np.sin(v), minor * np.sin(u)), axis=1)

    def at(i: NDArray[np.int64], j: NDArray[np.int64]) -> NDArray[np.int64]:
        return (i % n_around * n_tube + j % n_tube).ravel()

    a, b = at(around, tube), at(around + 1, tube)
    c, d = at(around + 1, tube + 1), at(around, tube + 1)
    return vertices, np.concatenate((np.stack((a, b, c), axis=1), np.stack((a, c, d), axis=1)))


def shell_mesh(subdivisions: int = 3, radius: float = 1.0, thickness: float = 0.1) -> Mesh:
    """Both sides of a hollow ball, χ = 4: a sphere and, facing inward, a smaller one."""
    vertices, faces = icosphere(subdivisions, radius)
    return joined((vertices, faces), (vertices * (radius - thickness) / radius, faces[:, ::-1]))


def linked_tori_mesh(n_around: int = 60, n_tube: int = 30, major: float = 1.0, minor: float = 0.25) -> Mesh:
    """Two tori linked like the rings of a chain, χ = 0."""
    vertices, faces = torus_mesh(n_around, n_tube, major, minor)
    upright = vertices[:, [0, 2, 1]] * (1, -1, 1) + (major, 0, 0)
    return joined((vertices, faces), (upright, faces))


def joined(*meshes: Mesh) -> Mesh:
    """Several meshes as one; nothing is merged."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in meshes])
    faces = [own + start for (_, own), start in zip(meshes, starts[:-1], strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def genus_mesh(genus: int, resolution: int = 24) -> Mesh:
    """A smooth bar with `genus` holes in a row, χ = 2 − 2·genus: the level set of a product of circles.

    Args:
        genus: number of holes, at least 1.
        resolution: grid cells across one hole's ring.

    Raises:
        InputError: if genus is less than 1.
    """
    from skimage.measure import marching_cubes

    if genus < 1:
        raise InputError(f"genus is {genus}; this shape has at least one hole (use icosphere for none).")
    step = 2.4 / resolution
    x = np.arange(-1.6, 2 * genus - 0.4 + step, step)
    y = np.arange(-1.6, 1.6 + step, step)
    z = np.arange(-0.8, 0.8 + step, step)
    gx, gy, gz = np.meshgrid(x, y, z, indexing="ij")
    rings = np.stack([np.hypot(gx - 2 * hole, gy) - 1 for hole in range(genus)])
    nearest = -np.log(np.exp(-8 * np.abs(rings)).sum(axis=0)) / 8  # a smooth minimum of the distances to the circles
    field = np.hypot(nearest, gz) - 0.35
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(step,) * 3, gradient_direction="descent")
    return vertices.astype(np.float64), faces.astype(np.int64)
