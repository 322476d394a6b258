"""How wide a solid or its background is at some places: the largest balls between samples of the surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Floats, Integers
from topokit.core.grid.tiles import tiles_of
from topokit.core.surface import TriangleSurface

_STEPS = np.arange(-2, 3) / 4  # of a voxel, within which the center of the ball is looked for
_TILE = 16  # voxels along each axis of which the surface is made at a time


class SurfaceWidths:
    """Diameters of the largest balls near voxels that the surface does not enter, where they are small.

    The surface is made only around the tiles of the volume in which there are such voxels.

    Args:
        surface: the surface in a box of voxels, given by its lowest and its first voxel beyond, as triangles about as
            large as a voxel; None if there is none. At the box's sides it may be closed.
        spacing: size of a voxel along each axis.
        most: up to which diameters are right; wider ones are at least so wide.
    """

    def __init__(
        self,
        surface: Callable[[Integers, Integers], TriangleSurface | None],
        spacing: tuple[float, float, float],
        most: float,
    ) -> None:
        self._surface = surface
        self._spacing = np.array(spacing)
        self._margin = 2 + np.ceil(most / 2 / self._spacing).astype(np.int64)
        around = np.stack(np.meshgrid(_STEPS, _STEPS, _STEPS, indexing="ij"), axis=-1).reshape(-1, 3)
        self._around = around * spacing
        self._trees: dict[tuple[int, ...], cKDTree | None] = {}

    def at(self, origin: Floats, voxels: Integers) -> Floats:
        """The diameters (M,) at the centers of voxels (M, 3), the first of which is at the origin."""
        found = np.full(len(voxels), np.inf)
        for first, rows in tiles_of(voxels, _TILE):
            if (tree := self._tree(first)) is not None:
                centers = (origin + voxels[rows] * self._spacing)[:, None] + self._around
                found[rows] = 2 * tree.query(centers)[0].max(axis=1)
        return found

    def _tree(self, first: Integers) -> cKDTree | None:
        """Of samples of the surface around a tile, which is given by its first voxel."""
        name = tuple(first.tolist())
        if name not in self._trees:
            surface = self._surface(first - self._margin, first + _TILE + self._margin)
            self._trees[name] = (
                None if surface is None else cKDTree(_samples(surface), compact_nodes=False, balanced_tree=False)
            )
        return self._trees[name]


def _samples(surface: TriangleSurface) -> Floats:
    """Vertices, and the middles of faces and edges."""
    corners = surface.vertices[surface.faces]
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    return np.concatenate((surface.vertices, corners.mean(axis=1), middles.reshape(-1, 3)))
