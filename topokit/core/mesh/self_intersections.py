"""Faces of a mesh that cross each other, found by libigl with exact predicates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from topokit.errors import MissingDependencyError

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]

_FOLDED = 1e-12  # 1 − cosine between two faces at an edge up to which they lie on each other: an angle of 1e-6


def intersecting_faces(vertices: Floats, faces: Integers) -> Integers:
    """Pairs of faces that meet elsewhere than in a vertex or an edge of both; equal faces are left out.

    Args:
        vertices: (V, 3).
        faces: (F, 3).

    Returns:
        (P, 2) rows of `faces`.

    Raises:
        MissingDependencyError: if libigl is not installed.
    """
    try:
        from igl.predicates import find_self_intersections
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            'self-intersections are found by libigl, which is not installed: pip install "topokit[defects]", or pass '
            "self_intersections=False."
        ) from error
    _, pairs, _ = find_self_intersections(np.ascontiguousarray(vertices), np.ascontiguousarray(faces))
    pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
    return pairs[~_meet_in_their_edge_only(vertices, faces[pairs[:, 0]], faces[pairs[:, 1]])]


def _meet_in_their_edge_only(vertices: Floats, first: Integers, second: Integers) -> NDArray[np.bool_]:
    """Pairs of faces (P, 3) with a common edge that are not folded onto each other, and pairs of equal faces.

    libigl takes faces on either side of an edge for intersecting if they are not oriented alike.
    """
    is_shared = (first[:, :, None] == second[:, None, :]).any(axis=2)
    n_shared = is_shared.sum(axis=1)
    rows = np.flatnonzero(n_shared == 2)
    own = first[rows]
    third = is_shared[rows].argmin(axis=1)
    at = np.arange(len(rows))
    a, b, c = (vertices[own[at, (third + step) % 3]] for step in (1, 2, 0))
    other = second[rows]
    d = vertices[other[at, (other[:, :, None] == own[:, None, :]).any(axis=2).argmin(axis=1)]]
    normal, other_normal = np.cross(b - a, c - a), np.cross(b - a, d - a)
    sizes = np.linalg.norm(normal, axis=1) * np.linalg.norm(other_normal, axis=1)
    is_folded = (normal * other_normal).sum(axis=1) >= (1 - _FOLDED) * sizes
    harmless = n_shared == 3
    harmless[rows] = ~is_folded
    return harmless
