"""Pictures of surfaces as small discs (surfels) in a z-buffer, shaded and smoothed; NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.surface import vector_areas

_FINE = 3  # pixels along a pixel of the picture
_PLASTIC = np.array([0.7548776662466927, 0.5698402909980532])  # steps of the R2 sequence: even points in a square
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
    vertices: Floats, faces: Integers, normals: Floats, colors: Floats, n_surfels: int = 2_000_000
) -> Surfels:
    """Surfels spread evenly over a mesh; normals (V, 3) and colors (V, 3) are interpolated between vertices."""
    shares = np.linalg.norm(vector_areas(vertices[faces]), axis=1).cumsum()
    number = np.arange(n_surfels)
    face = faces[np.searchsorted(shares, shares[-1] * (number + 0.5) / n_surfels)]
    u, v = (number[:, None] * _PLASTIC % 1).T
    u = np.sqrt(u)
    weights = np.stack([1 - u, u * (1 - v), u * v])
    points, directions, tints = (
        sum(weight[:, None] * values[corner] for weight, corner in zip(weights, face.T, strict=True))
        for values in (vertices, normals, colors)
    )
    return Surfels(points, unit(directions), tints)


def disc_surfels(
    centers: Floats, normals: Floats, colors: Floats, radius: Floats | float, n_each: int = 150
) -> Surfels:
    """Surfels on a disc around each center, perpendicular to its normal; one radius, or an array (N, 1, 1)."""
    draw = np.random.default_rng(0)
    helper = np.eye(3)[np.abs(normals).argmin(1)]
    right = unit(np.cross(normals, helper))
    tangents = np.stack([right, np.cross(normals, right)], axis=1)
    angle, distance = 2 * np.pi * draw.random((len(centers), n_each)), np.sqrt(draw.random((len(centers), n_each)))
    offsets = radius * distance[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = centers[:, None] + offsets @ tangents
    shape = points.shape
    return Surfels(*(np.broadcast_to(x, shape).reshape(-1, 3) for x in (points, normals[:, None], colors[:, None])))


def render(surfels: Surfels, eye: tuple[float, float, float], side: int, fine: int = _FINE) -> NDArray[np.uint8]:
    """Square picture (side, side, 3) of the surface on white, seen in parallel projection; z is up.

    Args:
        surfels: the surface.
        eye: direction to the viewer.
        side: pixels of the picture.
        fine: rendered pixels along each of its pixels.
    """
    toward = unit(np.array(eye))
    right = unit(np.cross((0.0, 0.0, 1.0), toward))
    axes = np.stack([right, np.cross(toward, right), toward])
    low, high = (surfels.points @ axes.T).min(0), (surfels.points @ axes.T).max(0)
    extent = (high - low)[:2].max()
    scale = side * (1 - 2 * _MARGIN) / (extent if extent > 0 else 1.0)  # all in one place: a dot
    places = (surfels.points @ axes.T - (low + high) / 2) * scale  # in pixels of the picture
    nearest, depth = _nearest(places, side, fine)
    seen = nearest >= 0
    normals, colors = surfels.normals[nearest] @ axes.T, surfels.colors[nearest]
    normals = np.where(normals[..., 2:] < 0, -normals, normals)
    light = 0.36 + 0.62 * np.maximum(normals @ unit(_LIGHT), 0) + 0.16 * np.maximum(normals @ unit(_FILL), 0)
    glint = 0.22 * np.maximum(normals @ unit(unit(_LIGHT) + np.array([0, 0, 1.0])), 0) ** 50
    lit = colors * (light * _openness(depth, seen, side, fine))[..., None] + glint[..., None]
    picture = np.where(seen[..., None], np.clip(lit, 0, 1), 1.0)
    coarse = picture.reshape(side, fine, side, fine, 3).mean((1, 3))
    return np.rint(255 * coarse).astype(np.uint8)


def _nearest(places: Floats, side: int, fine: int) -> tuple[Integers, Floats]:
    """Index of the surfel nearest to the eye at every fine pixel, −1 for none, and its depth.

    A surfel covers 3 × 3 fine pixels.
    """
    n = side * fine
    order = places[:, 2].argsort()  # where an index is repeated, the last assignment counts
    columns, rows = (np.array([[1, -1]]) * places[order, :2] * fine + n / 2).astype(int).T
    layer = np.full((n + 2, n + 2), -1)
    layer[np.clip(rows, 0, n - 1) + 1, np.clip(columns, 0, n - 1) + 1] = order
    heights = np.where(layer >= 0, places[layer, 2], -np.inf)
    nearest, depth = np.full((n, n), -1), np.full((n, n), -np.inf)
    for y, x in np.ndindex(3, 3):
        window = slice(y, y + n), slice(x, x + n)
        closer = heights[window] > depth
        nearest[closer], depth[closer] = layer[window][closer], heights[window][closer]
    return nearest, depth


def _openness(depth: Floats, seen: Booleans, side: int, fine: int) -> Floats:
    """Share of the surrounding light at every pixel: less where the surface around is nearer to the eye."""
    filled, share = np.where(seen, depth, 0.0), np.ones(depth.shape)
    for blur, strength in _OCCLUSION:
        weight = np.maximum(gaussian_filter(seen.astype(float), blur * fine), 1e-9)
        rise = gaussian_filter(filled, blur * fine) / weight - filled
        share -= np.clip(strength * rise / (0.25 * side), 0, 0.35)
    return np.where(seen, share, 1.0)


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) divided by their lengths."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
