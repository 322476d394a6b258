"""Principal variances of neighborhoods of several sizes: flat, round or narrow, and at which size."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from topokit.core.arrays import Floats, Integers


def nested_variances(points: Floats, nearest: Integers, sizes: Sequence[int]) -> Floats:
    """Variances along the principal axes of each neighborhood's first points, (S, M, 3), ascending.

    Every point is added once: a neighborhood is the one before it and the points between the two.

    Args:
        points: (N, 3).
        nearest: (M, K), indices of neighbors, nearest first.
        sizes: S numbers of neighbors, ascending, at most K.
    """
    centers = points[nearest[:, 0], None]
    rings = [_moments(points[nearest[:, start:stop]] - centers) for start, stop in pairwise([0, *sizes])]
    sums = np.cumsum(rings, axis=0)
    mean = sums[..., 1:, 0] / sums[..., :1, 0]
    covariance = sums[..., 1:, 1:] / sums[..., :1, :1] - mean[..., None] * mean[..., None, :]
    return np.maximum(np.linalg.eigvalsh(covariance), 0.0)


def _moments(points: Floats) -> Floats:
    """Sums of (1, x) (1, x)ᵀ over points x, (M, K, 3): (M, 4, 4)."""
    rows = np.concatenate((np.ones_like(points[..., :1]), points), axis=2)
    return rows.transpose(0, 2, 1) @ rows
