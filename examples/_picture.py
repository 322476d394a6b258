"""Pictures of solids without a graphics card: parallel rays through a field on a grid, shaded where they enter it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates

Floats = NDArray[np.float64]

_SIDE, _FINER = 400, 2  # pixels along a panel, and rays along a pixel
_STEP = 0.5  # along a ray, in cells
_LIGHT = np.array([-0.45, 0.6, 0.66])  # right, up, towards the eye
_COLOUR = np.array([0.93, 0.63, 0.32])
_SKY, _GROUND, _DOT = np.array([0.97, 0.98, 1.0]), np.array([0.80, 0.84, 0.90]), np.array([0.10, 0.22, 0.38])


def save_pair(
    path: Path,
    before: ArrayLike,
    after: ArrayLike,
    eye: tuple[float, float, float] = (1.0, -1.6, 1.9),
    **options: float,
) -> None:
    """Write two solids side by side as a PNG, 800 × 400.

    Args:
        path: of the picture.
        before, after: fields (X, Y, Z), positive inside.
        eye: direction from the middle of the grid to whoever looks; z is up.
        options: see `panel`.
    """
    panels = [panel(np.asarray(field, dtype=np.float64), eye, **options) for field in (before, after)]
    Image.fromarray(np.concatenate(panels, axis=1)).save(path)
    print(f"picture: {path}")


def panel(field: Floats, eye: tuple[float, float, float], zoom: float = 1.0) -> NDArray[np.uint8]:
    """One solid, (side, side, 3)."""
    field = np.pad(field, 1, constant_values=min(-1e-3, float(field.min())))
    size = np.array(field.shape, dtype=np.float64)
    towards = np.array(eye) / np.linalg.norm(eye)
    right = np.cross((0.0, 0.0, 1.0), towards)
    right /= np.linalg.norm(right)
    up = np.cross(towards, right)
    n = _SIDE * _FINER
    across = (np.arange(n) + 0.5) / n - 0.5
    extent = 1.15 * size.max() / zoom
    starts = (size - 1) / 2 + extent * (across[None, :, None] * right - across[:, None, None] * up)
    solid, reach = _Solid(field), float(np.linalg.norm(size))
    hits, points = solid.first_hits(starts.reshape(-1, 3) + reach / 2 * towards, -towards, reach)
    height = np.linspace(1, 0, n)[:, None, None]
    picture = np.broadcast_to(height * _SKY + (1 - height) * _GROUND, (n, n, 3)).reshape(-1, 3).copy()
    normals = solid.normals(points)
    light = np.stack([right, up, towards], axis=1) @ (_LIGHT / np.linalg.norm(_LIGHT))
    direct = np.maximum(normals @ light, 0)
    direct[solid.first_hits(points + 1.5 * normals, light, reach)[0]] *= 0.25
    ambient = 0.34 + 0.16 * (normals @ up)
    glint = np.maximum(normals @ ((light + towards) / np.linalg.norm(light + towards)), 0) ** 40
    picture[hits] = np.clip(_COLOUR * (ambient + 0.75 * direct)[:, None] + 0.25 * (glint * (direct > 0))[:, None], 0, 1)
    blocks = picture.reshape(_SIDE, _FINER, _SIDE, _FINER, 3).mean((1, 3))
    return (255 * blocks + 0.5).astype(np.uint8)


class _Solid:
    """{field > 0} with the distance that is free of it around every voxel, so that rays take few steps."""

    def __init__(self, field: Floats) -> None:
        self.field = field
        self.slopes = np.gradient(gaussian_filter(field, 0.7))
        self.free = distance_transform_edt(field <= 0) - 2.6  # half a voxel's diagonal to its middle, one to a corner

    def first_hits(self, starts: Floats, direction: Floats, reach: float) -> tuple[NDArray[np.int64], Floats]:
        """Which rays enter the solid within `reach` cells, and where: indices (M,) and points (M, 3)."""
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
