"""Meshes of wires: tubes along the edges of polyhedra, and along torus knots; χ is known by construction."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from topokit.errors import InputError
from topokit.testing.meshes import Mesh

Frame = tuple[NDArray[np.float64], NDArray[np.int64]]
"""Vertices (V, 3) and edges (E, 2) of a polyhedron."""

_MARGIN = 3  # cells around the tubes
_BLEND = 8  # power of the smooth minimum that rounds off where tubes meet; in a sharp crease marching cubes errs
_NEAREST = 0.1  # radii below which a distance no longer matters


def triakis_tetrahedron() -> Frame:
    """The frame of a tetrahedron with a pyramid on each face: 8 vertices, 18 edges; its tubes have χ = −20."""
    signs = np.array(list(product((1.0, -1.0), repeat=3)))
    is_outer = signs.prod(1) > 0
    outer, inner = signs[is_outer] * 5 / 3, signs[~is_outer]
    base = [(i, j) for i in range(4) for j in range(i)]
    sides = [(i, 4 + j) for i in range(4) for j in range(4) if not np.allclose(outer[i], -inner[j] * 5 / 3)]
    return np.concatenate((outer, inner)), np.array(base + sides)


def deltoidal_icositetrahedron() -> Frame:
    """The frame of the polyhedron with 24 kites as faces: 26 vertices, 48 edges; its tubes have χ = −44."""
    corner = (2 * math.sqrt(2) + 1) / 7
    grid = np.array(list(product((1.0, 0.0, -1.0), repeat=3)))
    count = np.abs(grid).sum(1).astype(int)
    length = np.array((0.0, 1.0, math.sqrt(0.5), corner))[count]
    vertices = (grid * length[:, None])[count > 0]
    distance = np.linalg.norm(vertices[:, None] - vertices, axis=2)
    return vertices, np.argwhere(np.triu(distance < 0.8, 1))  # the edges are 0.77 and 0.59 long; then come 0.90 and 1


def edge_tubes(frame: Frame, radius: float = 0.06, resolution: int = 96) -> Mesh:
    """Round tubes along the edges of a polyhedron, joined at its vertices: χ = 2 (V − E) as a surface.

    Args:
        frame: vertices (V, 3) and edges (E, 2).
        radius: of the tubes, as a share of the longest edge.
        resolution: grid cells along the longest side.

    Raises:
        InputError: if a tube is thinner than two cells.
    """
    from skimage.measure import marching_cubes

    vertices, edges = frame
    start, way = vertices[edges[:, 0]], vertices[edges[:, 1]] - vertices[edges[:, 0]]
    thickness = radius * float(np.linalg.norm(way, axis=1).max())
    low, high = vertices.min(0) - thickness, vertices.max(0) + thickness
    step = float((high - low).max()) / resolution
    if thickness < 2 * step:
        raise InputError(f"tubes of {thickness / step:.1f} cells are too thin: use a larger radius or resolution.")
    low = low - _MARGIN * step
    axes = [np.arange(a, b + (_MARGIN + 1) * step, step) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    nearness = np.zeros(points.shape[:3])
    for a, d in zip(start, way, strict=True):
        offset = points - a
        along = np.clip(offset @ d / (d @ d), 0, 1)
        away = np.linalg.norm(offset - along[..., None] * d, axis=-1) / thickness
        nearness += np.maximum(away, _NEAREST) ** -_BLEND  # a smooth minimum of the distances to the edges
    found, faces, _, _ = marching_cubes(
        nearness ** (-1 / _BLEND), 1.0, spacing=(step,) * 3, gradient_direction="descent"
    )
    return found.astype(np.float64) + low, faces.astype(np.int64)


def torus_knot(turns: int = 2, winds: int = 3, radius: float = 0.2, n_along: int = 400, n_around: int = 24) -> Mesh:
    """A tube along the torus knot that turns around the axis and winds around the tube: a torus, χ = 0.

    Args:
        turns: times around the axis of a torus of radii 1 and 0.5.
        winds: times around its tube; (2, 3) is the trefoil. The two must have no common divisor.
        radius: of the tube.
        n_along: vertices along the knot.
        n_around: vertices around the tube.

    Raises:
        InputError: if the two numbers have a common divisor, which gives a link.
    """
    if math.gcd(turns, winds) != 1:
        raise InputError(f"{turns} turns and {winds} winds have a common divisor: choose numbers that have none.")
    t = np.arange(n_along) * 2 * math.pi / n_along
    distance = 1 + 0.5 * np.cos(winds * t)
    center = np.stack((distance * np.cos(turns * t), distance * np.sin(turns * t), 0.5 * np.sin(winds * t)), axis=1)
    ahead = np.roll(center, -1, axis=0) - np.roll(center, 1, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    core = np.stack((np.cos(turns * t), np.sin(turns * t), np.zeros_like(t)), axis=1)
    outward = (center - core) * 2
    first = outward - (outward * ahead).sum(1, keepdims=True) * ahead  # turns with the knot and closes with it
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(ahead, first)
    angle = np.arange(n_around) * 2 * math.pi / n_around
    ring = np.cos(angle)[None, :, None] * first[:, None] + np.sin(angle)[None, :, None] * second[:, None]
    vertices = (center[:, None] + radius * ring).reshape(-1, 3)
    along, around = np.meshgrid(np.arange(n_along), np.arange(n_around), indexing="ij")

    def at(i: NDArray[np.int64], j: NDArray[np.int64]) -> NDArray[np.int64]:
        return (i % n_along * n_around + j % n_around).ravel()

    a, b = at(along, around), at(along + 1, around)
    c, d = at(along + 1, around + 1), at(along, around + 1)
    return vertices, np.concatenate((np.stack((a, c, b), axis=1), np.stack((a, d, c), axis=1)))
