"""How wide a solid or its background is at some places: the largest balls between samples of the surface."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Floats
from topokit.core.surface import TriangleSurface

_STEPS = np.arange(-2, 3) / 4  # of a voxel, within which the center of the ball is looked for


class SurfaceWidths:
    """Diameters of the largest balls near voxels that the surface does not enter.

    Args:
        surface: triangles about as large as a voxel.
        spacing: size of a voxel along each axis.
    """

    def __init__(self, surface: TriangleSurface, spacing: tuple[float, float, float]) -> None:
        corners = surface.vertices[surface.faces]
        middles = (corners + np.roll(corners, 1, axis=1)) / 2
        self._tree = cKDTree(np.concatenate((surface.vertices, corners.mean(axis=1), middles.reshape(-1, 3))))
        around = np.stack(np.meshgrid(_STEPS, _STEPS, _STEPS, indexing="ij"), axis=-1).reshape(-1, 3)
        self._around = around * spacing

    def at(self, places: Floats) -> Floats:
        """The diameters (M,) at the centers of voxels (M, 3)."""
        found = self._tree.query((places[:, None] + self._around).reshape(-1, 3))[0]
        return np.asarray(2 * found.reshape(len(places), -1).max(axis=1))
