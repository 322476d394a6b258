"""Signs for normal axes, carried from neighbor to neighbor along a spanning tree of least bending.

The tree prefers steps between points whose axes are parallel and that lie in each other's tangent planes, so it follows
sheets and crosses a crease or the gap to another sheet only where it must. Where it does, signs may go wrong: the parts
between such steps are patches, and a patch is right or wrong as a whole.

References:
    H. Hoppe, T. DeRose, T. Duchamp, J. McDonald, W. Stuetzle, "Surface reconstruction from unorganized points",
    SIGGRAPH 1992, doi:10.1145/133994.134011, for the tree; the edge's share off the tangent planes is ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from topokit.core.cloud.planes import Faces
from topokit.core.labels import connected_labels

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_CREASE = 0.5  # weight of a step from which it separates two patches
_EDGES = 1 << 20  # edges whose ends are in memory at once
_SMALLEST_WEIGHT = 1e-6  # SciPy takes a zero for a missing edge


@dataclass(frozen=True, eq=False)
class Propagation:
    """Axes with signs.

    Attributes:
        normals: (N, 3), unit; outward if the tree made no mistake.
        parts: (N,), connected component of the neighbor graph.
        patches: (N,), part between the tree's steps over creases; signs are right or wrong together.
    """

    normals: Floats
    parts: Integers
    patches: Integers

    def sharpened(self, faces: Faces) -> Propagation:
        """The same with the faces' axes near creases; the signs are those of points farther from the crease."""
        return Propagation(faces.sharpened(self.normals), self.parts[faces.owner], self.patches[faces.owner])


def propagate_signs(points: Floats, axes: Floats, areas: Floats, neighbors: NDArray[np.int32]) -> Propagation:
    """Signs along the minimum spanning forest of the neighbor graph; each part encloses a positive volume.

    Args:
        points: (N, 3).
        axes: (N, 3), unit, of arbitrary sign.
        areas: (N,), surface area that each point stands for.
        neighbors: (N, k), without the point itself.
    """
    count = len(points)
    first, second = _edges(neighbors)
    weight = _bending(points, axes, first, second)
    tree = minimum_spanning_tree(coo_array((weight, (first, second)), shape=(count, count)).tocsr()).tocoo()
    parts = connected_labels(count, tree.row, tree.col)
    is_smooth = tree.data < _CREASE
    patches = connected_labels(count, tree.row[is_smooth], tree.col[is_smooth])
    normals = axes * _signs_along(tree.row, tree.col, parts, axes)[:, None]
    volume = np.bincount(parts, areas * _dots(normals, points))
    return Propagation(normals * np.where(volume < 0, -1.0, 1.0)[parts, None], parts, patches)


def _edges(neighbors: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Every edge of the neighbor graph once."""
    count, k = neighbors.shape
    first, second = np.repeat(np.arange(count, dtype=np.int32), k), neighbors.ravel()
    is_down = np.flatnonzero(first > second)
    is_double = np.zeros(len(is_down), dtype=bool)
    for column in neighbors.T:
        is_double |= column[second[is_down]] == first[is_down]
    kept = np.ones(len(first), dtype=bool)
    kept[is_down[is_double]] = False
    return first[kept], second[kept]


def _bending(points: Floats, axes: Floats, first: NDArray[np.int32], second: NDArray[np.int32]) -> Floats:
    """1 − |n·n′| plus the larger share by which each edge leaves one of its tangent planes."""
    bending = np.empty(len(first))
    for start in range(0, len(first), _EDGES):
        edges = slice(start, start + _EDGES)
        way = points[second[edges]] - points[first[edges]]
        one, other = axes[first[edges]], axes[second[edges]]
        length = np.maximum(np.sqrt(_dots(way, way)), 1e-300)
        leaves = np.maximum(np.abs(_dots(way, one)), np.abs(_dots(way, other))) / length
        bending[edges] = 1 - np.abs(_dots(one, other)) + leaves + _SMALLEST_WEIGHT
    return bending


def _dots(first: Floats, second: Floats) -> Floats:
    """Scalar products of rows (n, 3), as (n,)."""
    return np.asarray(np.einsum("na,na->n", first, second))


def _signs_along(row: Integers, column: Integers, parts: Integers, axes: Floats) -> Floats:
    """Sign of each point so that axes agree along every edge of the forest; products to the root by doubling."""
    count = len(parts)
    roots = np.unique(parts, return_index=True)[1]
    rows = np.concatenate((row, np.full(len(roots), count)))  # one more node joins all parts
    joined = coo_array((np.ones(len(rows)), (rows, np.concatenate((column, roots)))), shape=(count + 1, count + 1))
    parent = breadth_first_order(joined.tocsr(), count, directed=False)[1][:count].astype(np.int64)
    parent[roots] = roots
    sign = np.where(_dots(axes, axes[parent]) < 0, -1.0, 1.0)
    sign[roots] = 1.0
    while (parent[parent] != parent).any():
        sign, parent = sign * sign[parent], parent[parent]
    return sign
