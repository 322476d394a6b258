"""How wide a solid or its background is at some places: the largest balls between samples of the surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Floats, Integers
from topokit.core.surface import TriangleSurface

_STEPS = np.arange(-2, 3) / 4  # of a voxel, within which the center of the ball is looked for
_MOST_VOXELS = 1 << 16  # whose surface is made at a time, so that it stays in the cache


class SurfaceWidths:
    """Diameters of the largest balls near voxels that the surface does not enter, where they are small.

    The surface is made only in boxes around such voxels, many at a time.

    Args:
        surface: the surface in boxes of one size, given by their first voxels (N, 3) and the size, as triangles about
            as large as a voxel; None if there is none. The boxes are put in a row along the first axis, with a layer of
            voxels between them, and begin at 0; at their sides the surface may be closed.
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
        self._most = most
        self._margin = 2 + np.ceil(most / 2 / self._spacing).astype(np.int64)
        around = np.stack(np.meshgrid(_STEPS, _STEPS, _STEPS, indexing="ij"), axis=-1).reshape(-1, 3)
        self._around = around * spacing
        self._known: dict[tuple[int, ...], float] = {}

    def at(self, voxels: Integers) -> Floats:
        """The diameters (N,) at the centers of voxels (N, 3)."""
        names = [tuple(voxel) for voxel in voxels.tolist()]
        new = np.array(sorted(set(names) - self._known.keys()), dtype=np.int64).reshape(-1, 3)
        size = 2 * self._margin + 1
        n_boxes = max(1, _MOST_VOXELS // int(size.prod()))
        for start in range(0, len(new), n_boxes):
            part = new[start : start + n_boxes]
            self._known |= zip(map(tuple, part.tolist()), self._widths(part, size).tolist(), strict=True)
        return np.array([self._known[name] for name in names])

    def _widths(self, voxels: Integers, size: Integers) -> Floats:
        """Those of voxels (N, 3), the boxes around which have a size (3,)."""
        surface = self._surface(voxels - self._margin, size)
        if surface is None:
            return np.full(len(voxels), np.inf)
        tree = cKDTree(_samples(surface), compact_nodes=False, balanced_tree=False)
        middles = np.repeat(self._margin[None], len(voxels), axis=0)
        middles[:, 0] += np.arange(len(voxels)) * (size[0] + 1)
        centers = middles * self._spacing
        found: Floats = 2 * tree.query(centers)[0]
        narrow = np.flatnonzero(found < self._most)  # at the others there is a ball that is wide enough
        found[narrow] = 2 * tree.query(centers[narrow][:, None] + self._around)[0].max(axis=1, initial=0)
        return found


def _samples(surface: TriangleSurface) -> Floats:
    """Vertices, and the middles of faces and edges; of edges once, from the one of two faces in which they ascend."""
    corners = surface.vertices[surface.faces]
    ascends = surface.faces > np.roll(surface.faces, 1, axis=1)
    middles = (corners + np.roll(corners, 1, axis=1))[ascends] / 2
    return np.concatenate((surface.vertices, (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3, middles))
