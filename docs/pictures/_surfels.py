"""Pictures of surfaces as small discs (surfels) in a z-buffer, shaded and smoothed; NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Floats = NDArray[np.float64]

_FINE = 3  # pixels along a pixel of the picture
_FOOTPRINT = 3  # side of a surfel, in fine pixels
_MARGIN = 0.08  # of the picture's side, around the shape
_LIGHT, _FILL = np.array([-0.5, 0.65, 0.75]), np.array([0.8, -0.2, 0.5])  # right, up, toward the eye
_OCCLUSION = ((3.0, 1.2), (12.0, 0.8))  # blur of the depth in pixels of the picture, and its strength


@dataclass(frozen=True)
class Surfels:
    """Points (N, 3) of a surface with unit normals (N, 3) and colors (N, 3) of 0 … 1."""

    points: Floats
    normals: Floats
    colors: Floats

    def __add__(self, other: Surfels) -> Surfels:
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Surfels(*(np.concatenate(pair) for pair in pairs))


def mesh_surfels(
    vertices: Floats, faces: NDArray[np.int64], normals: Floats, colors: Floats, n_surfels: int = 2_000_000
) -> Surfels:
    """Surfels spread evenly over a mesh; normals (V, 3) and colors (V, 3) are interpolated between vertices."""
    draw = np.random.default_rng(0)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = faces[draw.choice(len(faces), n_surfels, p=areas / areas.sum())]
    u, v = np.sqrt(draw.random(n_surfels)), draw.random(n_surfels)
    weights = np.stack([1 - u, u * (1 - v), u * v], axis=1)[..., None]
    points, directions, tints = ((weights * values[face]).sum(1) for values in (vertices, normals, colors))
    return Surfels(points, unit(directions), tints)


def disc_surfels(centers: Floats, normals: Floats, colors: Floats, radius: float, n_each: int = 150) -> Surfels:
    """Surfels on a disc around each center, perpendicular to its normal."""
    draw = np.random.default_rng(0)
    helper = np.eye(3)[np.abs(normals).argmin(1)]
    right = unit(np.cross(normals, helper))
    tangents = np.stack([right, np.cross(normals, right)], axis=1)
    angle, distance = 2 * np.pi * draw.random((len(centers), n_each)), np.sqrt(draw.random((len(centers), n_each)))
    offsets = radius * distance[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = centers[:, None] + offsets @ tangents
    shape = points.shape
    return Surfels(*(np.broadcast_to(x, shape).reshape(-1, 3) for x in (points, normals[:, None], colors[:, None])))


def render(surfels: Surfels, eye: tuple[float, float, float], side: int) -> NDArray[np.uint8]:
    """Square picture (side, side, 3) of the surface on white, seen in parallel projection; z is up."""
    toward = unit(np.array(eye))
    right = unit(np.cross((0.0, 0.0, 1.0), toward))
    axes = np.stack([right, np.cross(toward, right), toward])
    low, high = (surfels.points @ axes.T).min(0), (surfels.points @ axes.T).max(0)
    scale = side * (1 - 2 * _MARGIN) / (high - low)[:2].max()
    places = (surfels.points @ axes.T - (low + high) / 2) * scale  # in pixels of the picture
    nearest, depth = _nearest(places, side)
    seen = nearest >= 0
    normals, colors = surfels.normals[nearest] @ axes.T, surfels.colors[nearest]
    normals = np.where(normals[..., 2:] < 0, -normals, normals)
    light = 0.36 + 0.62 * np.maximum(normals @ unit(_LIGHT), 0) + 0.16 * np.maximum(normals @ unit(_FILL), 0)
    glint = 0.22 * np.maximum(normals @ unit(unit(_LIGHT) + np.array([0, 0, 1.0])), 0) ** 50
    lit = colors * (light * _openness(depth, seen, side))[..., None] + glint[..., None]
    picture = np.where(seen[..., None], np.clip(lit, 0, 1), 1.0)
    coarse = picture.reshape(side, _FINE, side, _FINE, 3).mean((1, 3))
    return np.rint(255 * coarse).astype(np.uint8)


def _nearest(places: Floats, side: int) -> tuple[NDArray[np.int64], Floats]:
    """Index of the surfel nearest to the eye at every fine pixel, −1 for none, and its depth."""
    n = side * _FINE
    order = places[:, 2].argsort()  # where an index is repeated, the last assignment counts
    columns, rows = (np.array([[1, -1]]) * places[order, :2] * _FINE + n / 2).astype(int).T
    nearest, depth = np.full(n * n, -1), np.full(n * n, -np.inf)
    for shift in np.ndindex(_FOOTPRINT, _FOOTPRINT):
        x, y = columns + shift[0] - _FOOTPRINT // 2, rows + shift[1] - _FOOTPRINT // 2
        layer = np.full(n * n, -1)
        layer[np.clip(y, 0, n - 1) * n + np.clip(x, 0, n - 1)] = order
        heights = np.where(layer >= 0, places[layer, 2], -np.inf)
        closer = heights > depth
        nearest[closer], depth[closer] = layer[closer], heights[closer]
    return nearest.reshape(n, n), depth.reshape(n, n)


def _openness(depth: Floats, seen: NDArray[np.bool_], side: int) -> Floats:
    """Share of the surrounding light at every pixel: less where the surface around is nearer to the eye."""
    filled, share = np.where(seen, depth, 0.0), np.ones(depth.shape)
    for blur, strength in _OCCLUSION:
        weight = np.maximum(gaussian_filter(seen.astype(float), blur * _FINE), 1e-9)
        rise = gaussian_filter(filled, blur * _FINE) / weight - filled
        share -= np.clip(strength * rise / (0.25 * side), 0, 0.35)
    return np.where(seen, share, 1.0)


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) divided by their lengths."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
