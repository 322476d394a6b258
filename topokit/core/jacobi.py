"""Eigenvectors of many symmetric 3×3 matrices by Jacobi rotations: the same operations whatever the values are."""

from __future__ import annotations

import torch
from torch import Tensor

_SWEEPS = 6  # convergence is quadratic: four reach double precision on random matrices, two more on graded ones


def eigenvector_by_rotations(matrix: Tensor) -> Tensor:
    """Unit eigenvector to the smallest eigenvalue, without a derivative; any one where it is not determined.

    Args:
        matrix: (n, 3, 3), symmetric.

    Returns:
        (n, 3), of arbitrary sign.

    Reference:
        G. H. Golub, C. F. Van Loan, Matrix Computations, section 8.5 (cyclic Jacobi).
    """
    diagonal = list(matrix.diagonal(dim1=-2, dim2=-1).unbind(-1))
    others = [matrix[..., 1, 2], matrix[..., 0, 2], matrix[..., 0, 1]]  # each at the index that it lacks
    vectors = list(torch.eye(3, dtype=matrix.dtype, device=matrix.device).expand(matrix.shape).unbind(-1))
    for _ in range(_SWEEPS):
        for p, q, r in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
            tangent = _tangent(diagonal[p], diagonal[q], others[r])
            cosine = (1 + tangent * tangent).rsqrt()
            sine = tangent * cosine
            diagonal[p], diagonal[q] = diagonal[p] - tangent * others[r], diagonal[q] + tangent * others[r]
            others[q], others[p] = cosine * others[q] - sine * others[p], sine * others[q] + cosine * others[p]
            others[r] = torch.zeros_like(tangent)
            c, s = cosine[..., None], sine[..., None]
            vectors[p], vectors[q] = c * vectors[p] - s * vectors[q], s * vectors[p] + c * vectors[q]
    smallest = torch.stack(diagonal, -1).argmin(-1)
    return torch.stack(vectors, -1).take_along_dim(smallest[..., None, None], dim=-1).squeeze(-1)


def _tangent(first: Tensor, second: Tensor, other: Tensor) -> Tensor:
    """Tangent of the angle, at most 45°, of the rotation that makes the entry `other` between two axes zero."""
    difference, doubled = second - first, 2 * other
    size = difference.abs() + torch.hypot(difference, doubled)
    return torch.where(difference < 0, -doubled, doubled) / torch.where(size > 0, size, 1)
