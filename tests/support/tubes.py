"""Samples of thin round tubes along segments, for tests of clouds whose walls are not resolved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def tube(segments: Floats, radius: float, n_points: int, seed: int = 0) -> tuple[Floats, Floats]:
    """Uniform samples of the surface of all points within a distance of segments, and outward normals.

    Args:
        segments: (S, 2, 3), end points.
        radius: the distance.
        n_points: number of samples N.
        seed: of the random numbers.

    Returns:
        (N, 3) points and (N, 3) unit normals.
    """
    rng = np.random.default_rng(seed)
    start, way = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(way, axis=1)
    ends = np.unique(segments.reshape(-1, 3).round(9), axis=0)
    area = np.concatenate((2 * np.pi * radius * length, np.full(len(ends), 4 * np.pi * radius**2)))
    part = rng.choice(len(area), 3 * n_points, p=area / area.sum())
    is_side = part < len(segments)
    which = np.where(is_side, part, 0)
    away = rng.normal(size=(len(part), 3))
    axis = way[which] / length[which, None]
    away -= np.where(is_side, (away * axis).sum(1), 0.0)[:, None] * axis
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    on_axis = start[which] + rng.random((len(part), 1)) * way[which]
    on_axis[~is_side] = ends[part[~is_side] - len(segments)]
    points = on_axis + radius * away
    kept = np.flatnonzero(_depth(points, start, way) > radius * (1 - 1e-9))[:n_points]
    assert len(kept) == n_points
    return points[kept], away[kept]


def _depth(points: Floats, start: Floats, way: Floats) -> Floats:
    """Distance of each point (N, 3) to the nearest segment."""
    nearest = np.full(len(points), np.inf)
    for origin, direction in zip(start, way, strict=True):
        along = np.clip((points - origin) @ direction / (direction @ direction), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(points - origin - along[:, None] * direction, axis=1))
    return nearest


def cube_edges() -> Floats:
    """The twelve edges of the unit cube: a graph with five independent cycles."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    pairs = [(i, j) for i in range(8) for j in range(i) if np.abs(corners[i] - corners[j]).sum() == 1]
    return corners[np.array(pairs)]


def torus_knot(p: int, q: int, n_segments: int = 80) -> Floats:
    """A closed polygon along the (p, q) torus knot."""
    t = np.linspace(0, 2 * np.pi, n_segments, endpoint=False)
    around = 1 + 0.4 * np.cos(q * t)
    corners = np.stack((around * np.cos(p * t), around * np.sin(p * t), 0.4 * np.sin(q * t)), 1)
    return np.stack((corners, np.roll(corners, -1, 0)), 1)


def linked_rings(n_segments: int = 40) -> Floats:
    """Two circles of radius one, each through the other's center."""
    t = np.linspace(0, 2 * np.pi, n_segments, endpoint=False)
    one = np.stack((np.cos(t), np.sin(t), 0 * t), 1)
    two = np.stack((1 + np.cos(t), 0 * t, np.sin(t)), 1)
    return np.concatenate([np.stack((ring, np.roll(ring, -1, 0)), 1) for ring in (one, two)])
