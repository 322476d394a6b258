"""Points that repeat others: exact copies, and copies that differ by far less than the distance to the next place."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Floats, Integers
from topokit.core.labels import connected_labels, inverse_order
from topokit.core.neighbors.kd_tree import nearest_in_tree

_APART = 10.0  # times as far as a copy is the next place; 1 in 100 random points of a surface have such a copy
_NEARLY = 4.0  # the same in clouds that do hold copies, so that groups are found whole; 6 in 100 random points
_SHARE = 0.15  # of points with a copy from which a cloud holds copies; random points of a curve reach 0.12
_PROBE = 1000  # points among which copies are looked for first
_MOST = 20  # neighbors among which copies are looked for; exact copies may be any number
_ROWS = 1 << 16  # points whose copies are looked for at once, to bound memory


def places(points: Floats, normals: Floats | None = None) -> tuple[Integers, Integers]:
    """Indices of the first point at each place, ascending, and for every point (N,) its position in that list.

    Points at one position are one place. Near copies are points much nearer to each other than to any other point whose
    normals, where given, do not oppose each other. They are one place, too, but only in clouds with more of them than
    chance explains. Every farther copy is several times as far as the one before, so lines of points are not joined.

    Args:
        points: (N, 3), with distances whose squares are finite.
        normals: (N, 3), of any length, or None; the two sides of a thin wall have opposite ones.
    """
    first, owner = distinct(points)
    count = len(first)
    if count <= _MOST:
        return first, owner
    positions, directions = points[first], None if normals is None else normals[first]
    tree = cKDTree(positions, balanced_tree=False, compact_nodes=False)
    probe = np.arange(0, count, max(1, count // _PROBE))
    if len(np.unique(_copies(tree, probe, directions, _APART)[0])) < _SHARE * len(probe):
        return first, owner
    blocks = np.array_split(np.arange(count), -(-count // _ROWS))
    pairs = np.concatenate([_copies(tree, rows, directions, _NEARLY) for rows in blocks], axis=1)
    label = connected_labels(count, *pairs)
    return first[np.unique(label, return_index=True)[1]], label[owner]


def _copies(tree: cKDTree, rows: Integers, normals: Floats | None, apart: float) -> Integers:
    """Pairs (2, E) of some points of the tree and their copies: the neighbors before the last gap in distance."""
    neighbors = nearest_in_tree(tree, tree.data[rows], _MOST + 1)[:, 1:]
    distance = np.linalg.norm(tree.data[neighbors] - tree.data[rows, None], axis=2)
    is_gap = apart * distance[:, :-1] <= distance[:, 1:]
    n_copies = (is_gap * np.arange(1, _MOST)).max(axis=1)
    is_copy = np.arange(_MOST) < n_copies[:, None]
    if normals is not None:
        is_copy &= np.einsum("mki,mi->mk", normals[neighbors], normals[rows]) >= 0
    row, rank = np.nonzero(is_copy)
    return np.stack((rows[row], neighbors[row, rank]))


def distinct(points: Floats) -> tuple[Integers, Integers]:
    """Indices of the first point at each position, ascending, and for every point (N,) its position in that list."""
    factors = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
    bits = (points + 0.0).view(np.uint64)  # −0 becomes 0
    bits ^= bits >> np.uint64(32)  # single precision leaves the lower half empty, and products with it
    _, first, group = np.unique((bits * factors).sum(1), return_index=True, return_inverse=True)
    if not (points[first[group]] == points).all():  # two positions with one hash
        _, first, group = np.unique(points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    return first[order], inverse_order(order)[group.ravel()]
