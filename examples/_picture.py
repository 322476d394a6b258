"""Ray-cast pictures of solids that are given by fields on a grid, with shadows; NumPy only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates

Floats = NDArray[np.float64]

_SIDE, _RAYS = 400, 2  # pixels along a panel, and rays along a pixel
_STEP = 0.5  # along a ray, in cells
_DOT_SIZE = 3  # rays
_SHADOW = 0.25  # of the light
_LIGHT = np.array([-0.45, 0.6, 0.66])  # direction to the light: right, up, toward the eye
_COLOR = np.array([0.93, 0.63, 0.32])
_SKY, _GROUND, _DOT = np.array([[0.97, 0.98, 1.0], [0.80, 0.84, 0.90], [0.10, 0.22, 0.38]])


def save_pair(
    path: Path,
    before: ArrayLike,
    after: ArrayLike,
    *,
    eye: tuple[float, float, float] = (1.0, -1.6, 1.9),
    zoom: float = 1.0,
    dots: tuple[ArrayLike, ArrayLike] = ((), ()),
) -> None:
    """Write two solids side by side as a PNG, 800 × 400, and print its path.

    Args:
        path: of the picture.
        before: field (X, Y, Z), positive inside.
        after: the same at the end of the training.
        eye: direction from the center of the grid to the viewer; z is up.
        zoom: 1 shows the whole grid.
        dots: points (N, 3) to mark on either solid, in steps of the grid from its first point.
    """
    views = [
        _render(np.asarray(field, dtype=np.float64), np.asarray(marks, dtype=np.float64).reshape(-1, 3), eye, zoom)
        for field, marks in zip((before, after), dots, strict=True)
    ]
    Image.fromarray(np.concatenate(views, axis=1)).save(path)
    print(f"picture: {path}")


def _render(field: Floats, dots: Floats, eye: tuple[float, float, float], zoom: float) -> NDArray[np.uint8]:
    """Image (side, side, 3) of one solid."""
    field = np.pad(field, 1, constant_values=min(-1e-3, float(field.min())))
    center, reach = (np.array(field.shape) - 1) / 2, float(np.linalg.norm(field.shape))
    toward = np.array(eye) / np.linalg.norm(eye)
    right = np.cross((0.0, 0.0, 1.0), toward)
    right /= np.linalg.norm(right)
    up = np.cross(toward, right)
    n, extent = _SIDE * _RAYS, 1.15 * max(field.shape) / zoom
    across = extent * ((np.arange(n) + 0.5) / n - 0.5)
    starts = (across[None, :, None] * right - across[:, None, None] * up).reshape(-1, 3) + center
    solid = _Solid(field)
    hits, points = solid.first_hits(starts + reach / 2 * toward, -toward, reach)

    height = np.linspace(1, 0, n)[:, None, None]
    picture = np.broadcast_to(height * _SKY + (1 - height) * _GROUND, (n, n, 3)).reshape(-1, 3).copy()
    normals = solid.normals(points)
    light = np.stack([right, up, toward], axis=1) @ (_LIGHT / np.linalg.norm(_LIGHT))
    direct = np.maximum(normals @ light, 0)
    direct[solid.first_hits(points + 1.5 * normals, light, reach)[0]] *= _SHADOW
    ambient = 0.34 + 0.16 * (normals @ up)
    glint = np.maximum(normals @ ((light + toward) / np.linalg.norm(light + toward)), 0) ** 40
    picture[hits] = np.clip(_COLOR * (ambient + 0.75 * direct)[:, None] + 0.25 * (glint * (direct > 0))[:, None], 0, 1)

    nearest = np.full(n * n, -np.inf)
    nearest[hits] = (points - center) @ toward
    dots = dots + 1 - center
    columns, rows = ((0.5 + dots @ right / extent) * n).astype(int), ((0.5 - dots @ up / extent) * n).astype(int)
    for shift in np.ndindex(_DOT_SIZE, _DOT_SIZE):
        pixel = np.clip(rows + shift[0], 0, n - 1) * n + np.clip(columns + shift[1], 0, n - 1)
        picture[pixel[dots @ toward > nearest[pixel] - 1.0]] = _DOT
    return (255 * picture.reshape(_SIDE, _RAYS, _SIDE, _RAYS, 3).mean((1, 3)) + 0.5).astype(np.uint8)


class _Solid:
    """The solid {field > 0}, with the distance to it from every voxel, so that rays take few steps."""

    def __init__(self, field: Floats) -> None:
        self.field = field
        self.slopes = np.gradient(gaussian_filter(field, 0.7))
        self.free = (
            distance_transform_edt(field <= 0) - 2.6
        )  # distances are between voxel centers: leave a margin of 1.5 diagonals

    def first_hits(self, starts: Floats, direction: Floats, reach: float) -> tuple[NDArray[np.int64], Floats]:
        """Rays that enter the solid within `reach` cells, and where: indices (M,) and points (M, 3)."""
        depth = np.zeros(len(starts))
        active = np.arange(len(starts))
        rays, places = [active[:0]], [starts[:0]]
        while len(active):
            points = starts[active] + depth[active, None] * direction
            value = _at(self.field, points)
            entered = value > 0
            here, now = points[entered], value[entered]
            before = np.minimum(_at(self.field, here - _STEP * direction), -1e-12)
            rays.append(active[entered])
            places.append(here - direction * (_STEP * now / (now - before))[:, None])
            free = self.free[tuple(np.clip(points.T + 0.5, 0, np.array(self.free.shape)[:, None] - 1).astype(int))]
            depth[active] += np.maximum(free, _STEP)
            active = active[~entered & (depth[active] < reach)]
        return np.concatenate(rays), np.concatenate(places)

    def normals(self, points: Floats) -> Floats:
        """Outward unit normals (M, 3)."""
        slope = np.stack([_at(part, points) for part in self.slopes], axis=1)
        return -slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)


def _at(field: Floats, points: Floats) -> Floats:
    return map_coordinates(field, points.T, order=1, mode="nearest")
