"""Normals by local PCA, with the covariance divided by its trace (paper, Section II-A)."""

from __future__ import annotations

from torch import Tensor

from topokit.core.linalg import smallest_eigenvector, trace


def normalized_covariance(offsets: Tensor) -> Tensor:
    """Covariance of a neighborhood divided by its trace.

    Args:
        offsets: (..., k, 3), neighbors minus center.

    Returns:
        (..., 3, 3) with trace 1, or 0 if all neighbors coincide.
    """
    largest = offsets.detach().abs().amax((-2, -1), keepdim=True)
    centered = offsets / largest.where(largest > 0, 1)  # scale to 1, so that squares cannot underflow
    centered = centered - centered.mean(-2, keepdim=True)
    covariance = centered.mT @ centered
    size = trace(covariance)
    return covariance / size.where(size > 0, 1)[..., None, None]


def normals_from_neighbors(offsets: Tensor) -> Tensor:
    """Direction of least spread of every neighborhood.

    Args:
        offsets: (..., k, 3), neighbors minus center, nearest first.

    Returns:
        (..., 3) unit normals of arbitrary sign. Differentiable; the derivative is bounded where the direction is not
        determined.
    """
    return smallest_eigenvector(normalized_covariance(offsets), offsets[..., -1, :])
