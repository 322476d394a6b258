"""Winding number of triangles around points, by summing solid angles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_PAIRS = 1 << 21  # triangle-point pairs held at once


def winding_numbers(triangles: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Generalised winding number of a triangle set around each point.

    Args:
        triangles: (F, 3, 3) corner coordinates, counter-clockwise from outside.
        points: (M, 3).

    Returns:
        (M,): 1 inside and 0 outside a closed outward mesh, fractions near open ones. Cost F·M, memory bounded.

    Reference:
        van Oosterom and Strackee 1983, DOI 10.1109/TBME.1983.325207; Jacobson et al. 2013,
        DOI 10.1145/2461912.2461916.
    """
    total = np.zeros(len(points))
    rows = max(1, _PAIRS // max(1, len(points)))
    for start in range(0, len(triangles), rows):
        a, b, c = (triangles[start : start + rows, None, i] - points[None] for i in range(3))  # (f, M, 3)
        la, lb, lc = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
        volume = (a * np.cross(b, c)).sum(-1)
        spread = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        total += np.arctan2(volume, spread).sum(0) / (2 * np.pi)
    return total


def contains(triangles: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether points lie inside a closed triangle set, whichever way it is oriented: (M,) bool."""
    return np.abs(winding_numbers(triangles, points)) > 0.5
