"""Faces of a mesh that cross each other, found by libigl with exact predicates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from topokit.errors import MissingDependencyError

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]


def intersecting_faces(vertices: Floats, faces: Integers) -> Integers:
    """Pairs of faces without a common edge that meet elsewhere than in a common vertex.

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
    first, second = faces[pairs[:, 0]], faces[pairs[:, 1]]
    n_common = (first[:, :, None] == second[:, None, :]).sum(axis=(1, 2))
    return pairs[n_common < 2]  # libigl reports neighbors that are not oriented alike, too
