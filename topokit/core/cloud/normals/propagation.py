"""Signs for normal axes: along a spanning tree of least bending within patches, by vote between them.

The tree prefers steps between points whose axes are parallel and that lie in each other's tangent planes, so it follows
sheets and crosses a crease or the gap to another sheet only where it must. There a single step says little, so the tree
is cut into patches, and all edges between two patches vote on their signs. An edge votes for the signs under which the
two normals mirror each other, as those of a circle do, at creases of any angle.

References:
    H. Hoppe, T. DeRose, T. Duchamp, J. McDonald, W. Stuetzle, "Surface reconstruction from unorganized points",
    SIGGRAPH 1992, doi:10.1145/133994.134011, for the tree; the edge's share off the tangent planes is ours.
    H. Xie, J. Wang, J. Hua, H. Qin, A. Kaufman, "Piecewise C¹ continuous surface reconstruction of noisy point clouds
    via local implicit quadric regression", IEEE Visualization 2003, for the mirror.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.normals.patch_graph import relative_signs
from topokit.core.cloud.settings import SignSettings
from topokit.core.labels import connected_labels

_EDGES = 1 << 20  # edges whose ends are in memory at once
_SMALLEST_WEIGHT = 1e-6  # SciPy takes a zero for a missing edge


@dataclass(frozen=True, eq=False)
class Propagation:
    """Axes with signs.

    Attributes:
        normals: (N, 3), unit; outward where no step and no vote went wrong.
        parts: (N,), connected component of the neighbor graph.
        patches: (N,), part between the tree's steps over creases; most of its signs are right or wrong together.
    """

    normals: Floats
    parts: Integers
    patches: Integers


def propagate_signs(
    points: Floats,
    axes: Floats,
    areas: Floats,
    neighbors: NDArray[np.int32],
    *,
    by_vote: bool,
    settings: SignSettings,
) -> Propagation:
    """Signs within patches along the minimum spanning forest of the neighbor graph, and between them by vote.

    Each connected part of the graph encloses a positive volume.

    Args:
        points: (N, 3).
        axes: (N, 3), unit, of arbitrary sign; at creases best those of the faces.
        areas: (N,), surface area that each point stands for.
        neighbors: (N, k), without the point itself.
        by_vote: whether patches vote; edges between noisy points point anywhere, so there the tree decides alone.
        settings: weights of steps within patches and over creases.
    """
    count = len(points)
    first, second = _edges(neighbors)
    weight = _bending(points, axes, first, second)
    tree = minimum_spanning_tree(coo_array((weight, (first, second)), shape=(count, count)).tocsr()).tocoo()
    parts = connected_labels(count, tree.row, tree.col)
    is_within = _within_patches(tree.data, settings) | (not by_vote)
    patches = connected_labels(count, tree.row[is_within], tree.col[is_within])
    normals = axes * _signs_along(tree.row[is_within], tree.col[is_within], patches, axes)[:, None]
    normals *= _voted_signs(points, normals, patches, first, second)[patches, None]
    volume = np.bincount(parts, areas * _dots(normals, points - _centroids(points, parts)[parts]))
    normals *= np.where(volume < 0, -1.0, 1.0)[parts, None]
    return Propagation(normals, parts, patches)


def _centroids(points: Floats, parts: Integers) -> Floats:
    """Mean of the points of each part (C, 3): about it, the volume that a small part encloses is not rounded away."""
    sums = np.stack([np.bincount(parts, column) for column in points.T], axis=1)
    return np.asarray(sums / np.maximum(np.bincount(parts), 1)[:, None])


def _within_patches(weight: Floats, settings: SignSettings) -> NDArray[np.bool_]:
    """Which steps of a tree (M,) lie within a patch: the light ones, and the lightest of others that are too many."""
    is_within, most = weight < settings.smooth, settings.most_patches
    if len(weight) - np.count_nonzero(is_within) >= most:
        is_within[:] = True
        is_within[np.argpartition(weight, -most)[-most:]] = False
    return is_within


def _voted_signs(
    points: Floats, normals: Floats, patches: Integers, first: NDArray[np.int32], second: NDArray[np.int32]
) -> Floats:
    """Relative signs of patches: an edge between two votes with the cosine of one normal and the mirrored other one."""
    between = np.flatnonzero(patches[first] != patches[second])
    first, second = first[between], second[between]
    votes = np.empty(len(first))
    for edges, way, one, other in _blocks(points, normals, first, second):
        along = _dots(way, one) * _dots(way, other) / np.maximum(_dots(way, way), 1e-300)
        votes[edges] = _dots(one, other) - 2 * along
    return relative_signs(int(patches.max()) + 1, patches[first], patches[second], votes)


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
    for edges, way, one, other in _blocks(points, axes, first, second):
        length = np.maximum(np.sqrt(_dots(way, way)), 1e-300)
        leaves = np.maximum(np.abs(_dots(way, one)), np.abs(_dots(way, other))) / length
        bending[edges] = 1 - np.abs(_dots(one, other)) + leaves + _SMALLEST_WEIGHT
    return bending


def _blocks(
    points: Floats, normals: Floats, first: NDArray[np.int32], second: NDArray[np.int32]
) -> Iterator[tuple[slice, Floats, Floats, Floats]]:
    """Some of the edges (E,) at a time: which, the way along each, and the normals at its ends."""
    for start in range(0, len(first), _EDGES):
        edges = slice(start, start + _EDGES)
        one, other = first[edges], second[edges]
        yield edges, points[other] - points[one], normals[one], normals[other]


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
