"""Vertices of a mesh that are written more than once: equal ones, and ones a rounding error apart."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.labels import connected_labels
from topokit.core.mesh.boxes import row_hashes

NEARLY_EQUAL = 1e-8  # share of the bounding box's diagonal within which vertices may be one rounded twice
_DIRECTION = np.array([0.5698, 0.6711, 0.4743])  # of no symmetry: distinct points rarely coincide along it


def equal_vertices(points: Floats) -> Integers:
    """The first vertex equal to each, in O(n log n): rows are sorted by a hash, and every equality is checked.

    Args:
        points: (N, 3), finite; −0.0 equals 0.0.

    Returns:
        (N,) indices.
    """
    rows = (points + 0.0).view(np.int64)  # −0.0 + 0.0 is 0.0
    hashes = row_hashes(rows, np.zeros(len(rows), dtype=np.int64))
    order = np.argsort(hashes, kind="stable")
    differs = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    if (differs & (hashes[order[1:]] == hashes[order[:-1]])).any():  # one hash for two places
        order = np.lexsort(rows.T)
        differs = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    starts = np.concatenate(([0], np.flatnonzero(differs) + 1))
    first = np.empty(len(points), dtype=np.int64)
    first[order] = np.repeat(order[starts], np.diff(starts, append=len(points)))
    return first


def rounding_radius(points: Floats) -> float:
    """The distance within which vertices (N, 3) may be one rounded twice."""
    return NEARLY_EQUAL * float(np.linalg.norm(np.ptp(points, axis=0)))


def may_have_near(points: Floats, radius: float) -> Booleans:
    """Which points may have another within a distance: (N,), with few of the others among them.

    Points within the radius of each other are so along any direction, too, where they are next to each other in order.
    """
    along = ((points - points[0]) * _DIRECTION).sum(axis=1)
    order = np.argsort(along)
    is_close = np.diff(along[order]) <= radius * (1 + 1e-6)
    found = np.zeros(len(points), dtype=bool)
    found[order[1:][is_close]] = True
    found[order[:-1][is_close]] = True
    return found


def near_vertices(points: Floats, radius: float, candidates: Booleans) -> Integers:
    """The first of the vertices that chains of steps within a distance join to each.

    Args:
        points: (N, 3).
        radius: of one step.
        candidates: (N,) all points that have another within the radius, see `may_have_near`.

    Returns:
        (N,) indices.
    """
    chosen = np.flatnonzero(candidates)
    first = np.arange(len(points))
    if len(chosen):
        pairs = cKDTree(points[chosen]).query_pairs(radius, output_type="ndarray")
        groups = connected_labels(len(chosen), pairs[:, 0], pairs[:, 1])
        first[chosen] = chosen[np.unique(groups, return_index=True)[1][groups]]
    return first
