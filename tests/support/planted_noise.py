"""Topological noise for tests: tiny tubes arched over a mesh or drilled under its surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from topokit.testing.meshes import Mesh

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

ARC_STEPS = 10
SHRUNK = 0.35  # size of the opening in a face
MOST_BENT = 0.95  # cosine of the angle between the two faces that a tube joins


def planted(mesh: Mesh, count: int, generator: np.random.Generator) -> Mesh:
    """A mesh with tiny tubes between nearby faces: one is a handle above the surface, the next a tunnel below it.

    The given vertices come first and stay where they are.
    """
    vertices, faces = mesh
    corners = vertices[faces]
    sides = np.roll(corners, -1, axis=1) - corners
    normals, centers = np.cross(sides[:, 0], sides[:, 1]), corners.mean(axis=1)
    doubled, perimeters = np.linalg.norm(normals, axis=1), np.linalg.norm(sides, axis=2).sum(axis=1)
    radii = doubled / perimeters  # of the inscribed circles
    normals /= np.maximum(doubled, 1e-300)[:, None]
    points, removed, tubes = vertices, [], []
    is_usable = radii > 0.07 * perimeters
    taken = np.zeros(len(faces), dtype=bool)
    for face in generator.permutation(np.flatnonzero(is_usable)):
        distance = np.linalg.norm(centers - centers[face], axis=1) / radii[face]
        wanted = is_usable & (distance > 9) & (distance < 14) & (normals @ normals[face] > MOST_BENT)
        around = distance < 28
        if taken[around].any() or not wanted.any() or (normals[around] @ normals[face]).min() < 0.5:
            continue
        other = int(np.flatnonzero(wanted)[0])
        radius, up = 0.3 * min(radii[face], radii[other]), normals[face] + normals[other]
        points, tube = _tube(points, faces[face], faces[other], up, radius, len(tubes) % 2 == 0)
        taken |= around
        removed += [face, other]
        tubes.append(tube)
        if len(tubes) == count:
            return points, np.concatenate((np.delete(faces, removed, axis=0), *tubes))
    raise ValueError(f"only {len(tubes)} of {count} tubes found a place")


def _tube(
    points: Floats, start: Integers, end: Integers, up: Floats, radius: float, is_above: bool
) -> tuple[Floats, Integers]:
    """Points with those of a tube added, and its triangles, which replace two faces."""
    first, last = points[start].mean(axis=0), points[end].mean(axis=0)
    rise = (up if is_above else -up) / np.linalg.norm(up)
    along = last - first
    along -= (along @ rise) * rise
    length = np.linalg.norm(along)
    along /= length
    side = np.cross(rise, along)
    turn = np.arange(3) * 2 * np.pi / 3 * (-1 if is_above else 1)
    rings = [first + SHRUNK * (points[start] - first)]
    for angle in np.linspace(0, np.pi, ARC_STEPS)[1:-1]:
        share = (1 - np.cos(angle)) / 2
        center = (1 - share) * first + share * last + np.sin(angle) * length / 2 * rise
        across = np.cos(angle) * -along + np.sin(angle) * rise
        rings.append(center + radius * (np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * side))
    backward = end[[0, 2, 1]]
    rings.append(last + SHRUNK * (points[backward] - last))
    every = np.concatenate((points, *rings))
    added = [len(points) + 3 * step + np.arange(3) for step in range(ARC_STEPS)]
    own, triangles = start, []
    for other in (*added, backward):
        shifts = [np.roll(other, shift) for shift in range(3)]
        following = min(shifts, key=lambda ring: float(np.linalg.norm(every[ring] - every[own])))
        for i, j in ((0, 1), (1, 2), (2, 0)):
            if np.linalg.norm(every[own[i]] - every[following[j]]) < np.linalg.norm(
                every[own[j]] - every[following[i]]
            ):
                triangles += [(own[i], own[j], following[j]), (own[i], following[j], following[i])]
            else:
                triangles += [(own[i], own[j], following[i]), (own[j], following[j], following[i])]
        own = following
    return every, np.array(triangles)
