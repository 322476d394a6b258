"""Pictures of scenes, made on the CPU without a display: surfels in a z-buffer."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.core.arrays import Floats, Integers
from topokit.core.surface import vector_areas
from topokit.export.colors import diverging_colors
from topokit.export.scene import Mark, MarkKind, Scene
from topokit.export.surfels import Surfels, disc_surfels, mesh_surfels, render, unit

Eye = tuple[float, float, float]
EYE: Eye = (0.9, -1.3, 1.0)
MARK_COLORS: Mapping[MarkKind, tuple[int, int, int]] = MappingProxyType(
    {
        **{"handle": (214, 96, 0), "tunnel": (0, 120, 80), "boundary": (120, 60, 160), "defect": (200, 0, 60)},
        **{"missing": (33, 102, 172), "spurious": (178, 24, 43)},
    }
)
_FINE = 2  # rendered pixels along a pixel of the picture
_PER_PIXEL = 10  # surfels of a surface for every pixel of the picture, so that few gaps show
_SMALLEST_CREASE = 0.75  # cosine between a face and its corner's mean normal below which the edge is drawn sharp
_LINE_WIDTH = 0.007  # of the shape's size
_UNKNOWN = (205, 208, 214)  # color where the curvature is unknown


def picture_of(scene: Scene, side: int, eye: Eye = EYE) -> NDArray[np.uint8]:
    """A square picture (side, side, 3) on white, in parallel projection; z is up.

    Args:
        scene: what to draw.
        side: pixels.
        eye: direction from the shape to the viewer.
    """
    n_surfels = _PER_PIXEL * side * side
    body = _points(scene, n_surfels) if scene.faces is None else _surface(scene, scene.faces, n_surfels)
    marks = [_tube(mark, _size(scene)) for mark in scene.marks]
    return render(sum(marks, body), eye, side, _FINE)


def colors_of(scene: Scene) -> NDArray[np.uint8]:
    """The colors (N, 3) of a scene's positions: blue is negative curvature, white zero, red positive."""
    known = np.isfinite(scene.values)
    colors = diverging_colors(np.where(known, scene.values, 0.0), scene.limit)
    colors[~known] = _UNKNOWN
    return colors


def _surface(scene: Scene, faces: Integers, n_surfels: int) -> Surfels:
    """Surfels on the triangles, smooth across flat edges and sharp across creases."""
    across = vector_areas(scene.positions[faces])
    sums = np.zeros_like(scene.positions)
    for corner in faces.T:
        np.add.at(sums, corner, across)
    flat = unit(across)
    corners = unit(sums)[faces]
    is_sharp = (corners * flat[:, None]).sum(-1, keepdims=True) < _SMALLEST_CREASE
    normals = np.where(is_sharp, flat[:, None], corners).reshape(-1, 3)
    colors = (colors_of(scene) / 255)[faces].reshape(-1, 3)
    apart = np.arange(3 * len(faces)).reshape(-1, 3)
    return mesh_surfels(scene.positions[faces].reshape(-1, 3), apart, normals, colors, n_surfels)


def _points(scene: Scene, n_surfels: int) -> Surfels:
    """A disc for every point, wide enough to meet its neighbors, of at least 36 surfels."""
    n_each = max(36, n_surfels // len(scene.positions))
    distances, _ = cKDTree(scene.positions).query(scene.positions, min(6, len(scene.positions)))
    radius = np.minimum(distances[:, -1], 2 * np.median(distances[:, -1]))[:, None, None]
    return disc_surfels(scene.positions, scene.normals, colors_of(scene) / 255, radius, n_each)


def _tube(mark: Mark, size: float) -> Surfels:
    """Surfels of a thick curve, or of a ball for every dot."""
    color = np.array(MARK_COLORS[mark.kind]) / 255
    radius = _LINE_WIDTH * size * (1.5 if mark.form == "dots" else 1)
    centers = mark.points if mark.form == "dots" else _resampled(mark, 0.5 * radius)
    draw = np.random.default_rng(0)
    normals = unit(draw.normal(size=(len(centers), 60, 3)))
    points = centers[:, None] + radius * normals
    return Surfels(*(np.broadcast_to(x, points.shape).reshape(-1, 3) for x in (points, normals, color)))


def _resampled(mark: Mark, step: float) -> Floats:
    """Points along the curve, at most `step` apart."""
    corners = np.concatenate((mark.points, mark.points[:1])) if mark.form == "loop" else mark.points
    along = np.concatenate(([0.0], np.linalg.norm(np.diff(corners, axis=0), axis=1).cumsum()))
    places = np.linspace(0, along[-1], int(along[-1] / step) + 2)
    return np.stack([np.interp(places, along, column) for column in corners.T], axis=1)


def _size(scene: Scene) -> float:
    return float(np.ptp(scene.positions, axis=0).max())
