"""Axes, areas and noise of every point of a large cloud, from neighborhoods of all its points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.core.cloud.neighborhoods import thicknesses
from topokit.core.cloud.planes import WIDE, Faces, Planes, find_faces, in_blocks

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]

_PROBES = 20_000  # points, evenly many along a curve, at which the roughness is measured
_GRAPH = 8  # neighbors that are kept for the graph, and of the disc whose area a point stands for


@dataclass(frozen=True, eq=False)
class SurfaceAxes:
    """What the neighborhoods of N points say.

    Attributes:
        tree: the tree of the points.
        neighbors: (N, 8), nearest first, without the point itself.
        planes: of these neighborhoods.
        areas: (N,), surface area that each point stands for.
        relative_thickness: median ratio of the thickness to the radius of the neighborhood of eight.
        thickness: median distance of sixteen neighbors from their plane, in units of length.
    """

    tree: cKDTree
    neighbors: Integers
    planes: Planes
    areas: Floats
    relative_thickness: float
    thickness: float

    @property
    def spacing(self) -> float:
        """√(mean area), the typical distance between neighboring points."""
        return float(np.sqrt(self.areas.mean()))

    @property
    def roughness(self) -> float:
        """Median distance of neighbors from the local plane in spacings, as in `LocalGeometry`."""
        return self.thickness / self.spacing

    @property
    def axes(self) -> Floats:
        """Unit normals (N, 3) of arbitrary sign (PCA): near creases between those of the faces."""
        return self.planes.axes

    @cached_property
    def faces(self) -> Faces | None:
        """The faces at creases; None if the points are too noisy to tell."""
        return find_faces(self.tree.data, self.planes, self.neighbors)

    @property
    def noise(self) -> float:
        """Standard deviation of the points from the surface, at most: bending counts, too."""
        return float(np.median(self.planes.thickness))


def surface_axes(points: Floats) -> SurfaceAxes:
    """Axes, areas and thickness at all points; blocks of points on all processors, so memory is bounded.

    Args:
        points: (N, 3), distinct, more than ten.
    """
    tree = cKDTree(points, balanced_tree=False)  # compact nodes pay where all points are looked up
    order = tree.indices  # neighboring queries share their way down the tree
    count = len(points)
    neighbors, radius = np.empty((count, _GRAPH), dtype=np.int32), np.empty(count)
    planes = Planes.empty(count)

    def measure(block: slice) -> None:
        rows = order[block]
        distance, index = tree.query(points[rows], WIDE + 1)
        neighbors[rows] = index[:, 1 : _GRAPH + 1]
        radius[rows] = distance[:, _GRAPH]
        planes.fit(rows, points.take(index, axis=0))

    in_blocks(measure, count)
    relative = float(np.median(planes.thickness / np.maximum(radius, 1e-300)))
    thickness = float(np.median(thicknesses(points, tree, order[:: -(-count // _PROBES)])))
    return SurfaceAxes(tree, neighbors, planes, np.pi * radius**2 / _GRAPH, relative, thickness)
