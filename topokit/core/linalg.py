"""Small symmetric matrices in closed form, with derivatives that stay finite where eigenvalues coincide."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.autograd import forward_ad

from topokit.core.residence import stays_on_device

_SWEEPS = 6  # convergence is quadratic: four reach double precision on random matrices, two more on graded ones


def normalize(vectors: Tensor) -> Tensor:
    """Unit vectors along the last axis; zero vectors stay zero, with zero gradient.

    Args:
        vectors: (..., d).

    Returns:
        (..., d). Scale-safe: the largest component is divided out first, so neither 1e-30 nor 1e30 is lost.
    """
    largest = vectors.detach().abs().amax(-1, keepdim=True)
    is_zero = largest == 0
    scaled = vectors / torch.where(is_zero, 1, largest)
    squared = scaled.square().sum(-1, keepdim=True)
    return scaled * torch.where(is_zero, 1, squared).rsqrt()


def squared_norm(vectors: Tensor) -> Tensor:
    """|v|² over a last axis of a few components, (..., d) → (...); several times faster than a sum along that axis."""
    first, *others = vectors.unbind(-1)
    total = first * first
    for part in others:
        total = total + part * part
    return total


def safe_sqrt(values: Tensor) -> Tensor:
    """√max(x, 0) whose derivative is 0 instead of infinite at x ≤ 0."""
    positive = values > 0
    return torch.where(positive, torch.where(positive, values, 1).sqrt(), 0)


def determinant(matrix: Tensor) -> Tensor:
    """Determinant of (..., 2, 2) matrices as (...,)."""
    return matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] * matrix[..., 1, 0]


def trace(matrix: Tensor) -> Tensor:
    """Trace of (..., d, d) matrices as (...,)."""
    return matrix.diagonal(dim1=-2, dim2=-1).sum(-1)


def adjugate(matrix: Tensor) -> Tensor:
    """Adjugate of (..., 2, 2) matrices: adj(A) A = det(A) I."""
    a, b = matrix[..., 0, 0], matrix[..., 0, 1]
    c, d = matrix[..., 1, 0], matrix[..., 1, 1]
    return torch.stack((d, -b, -c, a), dim=-1).unflatten(-1, (2, 2))


def lift_smallest_eigenvalue(matrix: Tensor, floor: Tensor) -> Tensor:
    """Add the multiple of the identity that keeps a positive semi-definite 2×2 matrix invertible.

    Matrices whose det/tr (which lies between λ_min/2 and λ_min) is at least `floor` are returned unchanged, so
    well-spread neighborhoods are not biased.

    Args:
        matrix: (..., 2, 2), symmetric positive semi-definite up to rounding.
        floor: (...,), positive.
    """
    size = trace(matrix)
    has_size = size > 0
    smallest = torch.where(has_size, determinant(matrix) / torch.where(has_size, size, 1), 0)
    lift = (floor - smallest).clamp(min=0)
    return matrix + lift[..., None, None] * torch.eye(2, dtype=matrix.dtype, device=matrix.device)


def eigenvalues(matrix: Tensor) -> Tensor:
    """Eigenvalues of symmetric 2×2 matrices, smallest first.

    Args:
        matrix: (..., 2, 2).

    Returns:
        (..., 2). At equal eigenvalues the gap has derivative 0 (each eigenvalue then moves with the mean).
    """
    middle = trace(matrix) / 2
    half_gap = safe_sqrt(((matrix[..., 0, 0] - matrix[..., 1, 1]) / 2).square() + matrix[..., 0, 1].square())
    return torch.stack((middle - half_gap, middle + half_gap), dim=-1)


def eigenvectors(matrix: Tensor) -> Tensor:
    """Unit eigenvectors of symmetric 2×2 matrices as rows, in the order of `eigenvalues`.

    Args:
        matrix: (..., 2, 2).

    Returns:
        (..., 2, 2), rows. Where the eigenvalues coincide any basis is right: the coordinate axes are returned, with
        zero gradient. Signs are arbitrary.
    """
    doubled = torch.stack((matrix[..., 0, 0] - matrix[..., 1, 1], 2 * matrix[..., 0, 1]), dim=-1)
    noise = torch.finfo(matrix.dtype).eps * 8 * matrix.detach().abs().amax((-2, -1))
    is_isotropic = doubled.detach().abs().amax(-1) <= noise
    angle = torch.atan2(doubled[..., 1].where(~is_isotropic, 0), doubled[..., 0].where(~is_isotropic, 1)) / 2
    cosine, sine = angle.cos(), angle.sin()
    return torch.stack((-sine, cosine, cosine, sine), dim=-1).unflatten(-1, (2, 2))


def tangent_basis(normals: Tensor, helper: Tensor) -> Tensor:
    """Right-handed orthonormal frames (t, t', n) whose t is the helper's tangential part.

    The angle of t within its plane is an arbitrary gauge, so the helper is detached; its tilt follows n, so the
    projection is differentiated.

    Args:
        normals: (..., 3) unit vectors.
        helper: (..., 3); where it is (almost) parallel to the normal, the least aligned coordinate axis replaces it.

    Returns:
        (..., 3, 3), rows t, t' = n × t, n.
    """
    helper = normalize(helper.detach())
    fixed = normals.detach()
    tangential = helper - (helper * fixed).sum(-1, keepdim=True) * fixed
    is_parallel = tangential.square().sum(-1, keepdim=True) < 1e-4
    least = (fixed.abs().argmin(-1, keepdim=True) == torch.arange(3, device=fixed.device)).to(fixed.dtype)
    helper = torch.where(is_parallel, least, helper)
    first = normalize(helper - (helper * normals).sum(-1, keepdim=True) * normals)
    second = torch.linalg.cross(normals, first, dim=-1)
    return torch.stack((first, second, normals), dim=-2)


# Smallest gap between the two lowest eigenvalues of a covariance of trace 1 that the derivative tells from 0. At a
# smaller one the two spreads differ by less than 3 % (√0.001) of the neighborhood's size: it has no tangent plane,
# and the exact derivative, which grows as 1/gap, would outweigh that of all other points.
LEAST_GAP = 1e-3


def smallest_eigenvector(matrix: Tensor, helper: Tensor, least_gap: float = LEAST_GAP) -> Tensor:
    """Unit eigenvector to the smallest eigenvalue of symmetric 3×3 matrices, with a bounded derivative.

    The decomposition itself runs outside the graph. One Newton step on the eigenvector equation, zero in value,
    carries the derivative dn = −T (Tᵀ(C − λI)T)⁻¹ Tᵀ dC n, in which the gaps 1/(λᵢ − λ_min) are bounded where the
    eigenvector is not determined (planes seen edge-on, balls, duplicate points). The step's error is of third order in
    dC, so that second derivatives are right, too, where the gaps are not bounded.

    Args:
        matrix: (..., 3, 3), symmetric; scaled so that its trace is about 1.
        helper: (..., 3), direction for the tangent gauge (see `tangent_basis`); the result does not depend on it.
        least_gap: lower bound of the gap λᵢ − λ_min in the derivative, as a share of the trace.

    Returns:
        (..., 3). The sign is arbitrary but deterministic.
    """
    fixed = matrix.detach()
    start = _smallest_eigenvector_value(fixed)
    if not _needs_derivative(matrix):
        return normalize(start)
    basis = tangent_basis(start, helper)
    tangent = basis[..., :2, :]  # (..., 2, 3)
    energy = (start.unsqueeze(-2) @ matrix @ start.unsqueeze(-1)).squeeze(-1)
    shifted = tangent @ matrix @ tangent.mT
    shifted = shifted - energy[..., None] * torch.eye(2, dtype=matrix.dtype, device=matrix.device)
    size = trace(fixed)
    shifted = lift_smallest_eigenvalue(shifted, least_gap * size.where(size > 0, 1))
    inverse = adjugate(shifted) / determinant(shifted)[..., None, None]
    residual = (tangent @ matrix @ start.unsqueeze(-1)) - (tangent @ fixed @ start.unsqueeze(-1))
    step = tangent.mT @ (inverse @ residual)
    return normalize(start - step.squeeze(-1))


def _needs_derivative(tensor: Tensor) -> bool:
    """Whether a derivative will be taken, backward or forward (`torch.func.jvp`)."""
    if tensor.requires_grad or torch.compiler.is_compiling():
        return torch.is_grad_enabled()
    return forward_ad.unpack_dual(tensor).tangent is not None


def _smallest_eigenvector_value(matrix: Tensor) -> Tensor:
    """Unit eigenvector to the smallest eigenvalue, without a derivative; five times faster than a decomposition.

    The eigenvalue is a root of the characteristic cubic in trigonometric form; the eigenvector is normal to the rows of
    C − λI, taken from the two that are least parallel. Its error is that of `torch.linalg.eigh`, eps / gap, while the
    smallest eigenvalue stands apart; matrices where it does not are decomposed.

    Args:
        matrix: (..., 3, 3), symmetric.

    Reference:
        O. K. Smith, Eigenvalues of a symmetric 3 × 3 matrix, CACM 4 (1961), doi:10.1145/355578.366316.
    """
    flat = matrix.reshape(-1, 3, 3)
    if stays_on_device(matrix):  # which matrices are decomposed below depends on their values
        return eigenvector_by_rotations(flat).reshape(matrix.shape[:-1])
    identity = torch.eye(3, dtype=matrix.dtype, device=matrix.device)
    deviation = flat - trace(flat)[:, None, None] / 3 * identity
    scale = (deviation.square().sum((-2, -1)) / 6).sqrt()
    first, second, third = deviation.unbind(-2)
    half = (first * torch.linalg.cross(second, third)).sum(-1) / (2 * scale**3)  # NaN for multiples of the identity
    smallest = 2 * scale * torch.cos(half.clamp(-1, 1).acos() / 3 + 2 * math.pi / 3)
    rows = deviation - smallest[:, None, None] * identity
    normals = torch.linalg.cross(rows, rows.roll(-1, dims=-2))
    squared, longest = squared_norm(normals).max(-1)
    vectors = normalize(normals.take_along_dim(longest[:, None, None], dim=1).squeeze(1))
    unclear = (~(squared > 1e-4 * scale**4)).nonzero().squeeze(1)  # a gap of about 1 % or less
    if len(unclear) > 0:
        vectors[unclear] = torch.linalg.eigh(flat[unclear]).eigenvectors[..., 0]
    return vectors.reshape(matrix.shape[:-1])


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
