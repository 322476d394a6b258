"""Moving frames: local PCA with the covariance divided by its trace (paper, Section II-A)."""

from __future__ import annotations

from torch import Tensor

from topokit.core.linalg import normalize, smallest_eigenvector, squared_norm, tangent_basis, trace


def normalized_covariance(offsets: Tensor) -> Tensor:
    """Covariance of a neighbourhood divided by its trace: (..., k, 3) → (..., 3, 3), trace 1 (0 if all coincide)."""
    largest = offsets.detach().abs().amax((-2, -1), keepdim=True)
    centred = offsets / largest.where(largest > 0, 1)  # units drop out, squares cannot underflow
    centred = centred - centred.mean(-2, keepdim=True)
    covariance = centred.mT @ centred
    size = trace(covariance)
    return covariance / size.where(size > 0, 1)[..., None, None]


def gauge(offsets: Tensor) -> Tensor:
    """Direction that fixes the angle of the tangent basis: the farthest neighbour. (..., k, 3) → (..., 3), detached.

    It turns with the points, so nothing computed from the frame depends on the pose of the cloud.
    """
    offsets = offsets.detach()
    farthest = squared_norm(offsets).argmax(-1)
    return offsets.take_along_dim(farthest[..., None, None], dim=-2).squeeze(-2)


def frames_from_neighbors(offsets: Tensor) -> Tensor:
    """Frames of neighbourhoods by local PCA.

    Args:
        offsets: (..., k, 3), neighbours minus centre.

    Returns:
        (..., 3, 3), rows t, t', n, right-handed; n spans the direction of least spread. Differentiable; derivatives
        are bounded where that direction is not determined. The sign of n is arbitrary (PCA knows no outside).
    """
    helper = gauge(offsets)
    return tangent_basis(smallest_eigenvector(normalized_covariance(offsets), helper), helper)


def frames_from_normals(normals: Tensor, offsets: Tensor) -> Tensor:
    """Frames around given normals.

    Args:
        normals: (..., 3), any positive length.
        offsets: (..., k, 3), neighbours minus centre; they only fix the gauge.

    Returns:
        (..., 3, 3), rows t, t', n, right-handed.
    """
    return tangent_basis(normalize(normals), gauge(offsets))
