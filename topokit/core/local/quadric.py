"""Quadrics z = f(x, y) fitted to neighborhoods: normals that curvature does not tilt, and how far the points lie off.

The plane of a neighborhood that lies lopsided on a curved surface is tilted; the quadric through it is not. Its own
second derivatives are noisy: curvature is better taken from the change of the normals (`weingarten_map`).

Reference:
    F. Cazals, M. Pouget, "Estimating differential quantities using polynomial fitting of osculating jets", CAGD 22
    (2005), doi:10.1016/j.cagd.2004.09.004.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.core.linalg import normalize, squared_norm, tangent_basis
from topokit.core.local.frames import normals_from_neighbors

TERMS = 6  # of a quadric: 1, x, y, x²/2, xy, y²/2
_FEWEST = 9  # neighbors of the same sheet; fewer than TERMS + 3 follow the noise rather than the surface
_STEEPEST = 1.0  # slope of a fit from which it no longer describes a graph over its plane


@dataclass(frozen=True, eq=False)
class QuadricFit:
    """Least-squares quadrics over the planes of m neighborhoods.

    Attributes:
        frames: (m, 3, 3), rows t, t', n of the plane.
        coefficients: (m, 6), of 1, x, y, x²/2, xy, y²/2, in units of `radius`.
        residual: (m, k), heights above the quadric in units of `radius`; 0 where the neighbor is on another sheet.
        inverse: (m, 6, 6), inverse of the normal matrix: the covariance of the coefficients for unit noise.
        radius: (m, 1, 1), distance of the farthest neighbor.
        n_used: (m,), neighbors of the same sheet.
    """

    frames: Tensor
    coefficients: Tensor
    residual: Tensor
    inverse: Tensor
    radius: Tensor
    n_used: Tensor

    def normals(self) -> Tensor:
        """Unit normals (m, 3) of the quadrics at the centers; those of the planes where a fit is not determined."""
        slope = self.coefficients[:, 1:3]
        is_good = (self.n_used >= _FEWEST) & (squared_norm(slope.detach()) <= _STEEPEST**2)
        up = torch.nn.functional.pad(-slope.where(is_good[:, None], 0), (0, 1), value=1.0)
        return normalize((up[:, None] @ self.frames).squeeze(1))


def fit_quadrics(offsets: Tensor) -> QuadricFit:
    """Fit a quadric to each neighborhood, over the plane of its least spread.

    Args:
        offsets: (m, k, 3), neighbors minus center, nearest first.

    Returns:
        `QuadricFit`, differentiable in the offsets. Neighbors more than 45° above the plane are left out.
    """
    frames = tangent_basis(normals_from_neighbors(offsets), offsets[:, -1])
    radius = offsets.detach().abs().amax((-2, -1), keepdim=True)
    x, y, z = ((offsets / radius.where(radius > 0, 1)) @ frames.mT).unbind(-1)
    is_used = (z * z <= x * x + y * y).detach()
    basis = torch.stack((torch.ones_like(x), x, y, x * x / 2, x * y, y * y / 2), dim=-1) * is_used[..., None]
    matrix = basis.mT @ basis
    ridge = torch.finfo(x.dtype).eps ** 0.75 * matrix.detach().diagonal(dim1=-2, dim2=-1).sum(-1)
    identity = torch.eye(TERMS, dtype=x.dtype, device=x.device)
    lifted = matrix + ridge.where(ridge > 0, 1)[:, None, None] * identity
    inverse = torch.linalg.inv_ex(lifted).inverse  # never singular: there is no error to look for
    coefficients = inverse @ (basis.mT @ z[..., None])
    residual = (z - (basis @ coefficients).squeeze(-1)) * is_used
    return QuadricFit(frames, coefficients.squeeze(-1), residual, inverse, radius, is_used.sum(-1))
