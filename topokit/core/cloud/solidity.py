"""Whether points fill space: a blob, a lattice or plain noise, of which no surface can be made.

Around a point of a surface the neighbors lie near a plane; of a noisy one this shows only in neighborhoods wider than
the noise, of one with many thin walls only in small ones. Where neighborhoods of all sizes extend as far in all three
directions as those of random points in space do, there is no surface at any scale.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]

_FEWEST = 10_000  # points from which noise, walls and space can be told apart
_ROUND = 0.55  # real shapes: at most 0.50 (10 000 points, 0.5 % noise), 0.53 (30 000, 1 %); blobs: at least 0.57
_SIZES = (16, 32, 64, 128)  # neighbors; eight times as wide in every thinner copy of the cloud
_THINNER = 8  # points of one copy per point of the next
_SMALLEST_COPY = 1_000  # points of the smallest copy
_PROBES = 250  # neighborhoods of each size


def fills_space(points: Floats) -> bool:
    """Whether the neighborhoods of points (N, 3), N ≥ 10 000, are round at all scales; never for fewer points."""
    return len(points) >= _FEWEST and least_roundness(points) > _ROUND


def least_roundness(points: Floats) -> float:
    """The median ratio of the smallest to the largest extent of neighborhoods (N, 3), at the scale where it is least.

    The extents are standard deviations along the principal axes: 0 in a plane, 1 in a large ball.
    """
    order = np.random.default_rng(0).permutation(len(points))
    found = [1.0]
    while len(order) >= _SMALLEST_COPY:
        copy = points[order]
        nearest = cKDTree(copy, balanced_tree=False, compact_nodes=False).query(copy[:_PROBES], _SIZES[-1])[1]
        found += [_median_roundness(copy[nearest[:, :size]]) for size in _SIZES]
        order = order[: len(order) // _THINNER]
    return min(found)


def _median_roundness(patches: Floats) -> float:
    patches = patches - patches.mean(1, keepdims=True)
    variance = np.linalg.eigvalsh(np.einsum("nka,nkb->nab", patches, patches))
    return float(np.median(np.sqrt(np.maximum(variance[:, 0], 0) / np.maximum(variance[:, 2], np.finfo(float).tiny))))
