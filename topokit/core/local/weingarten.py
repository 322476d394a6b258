"""The self-adjoint Weingarten map by least squares (paper, Section II-B), without an eigendecomposition."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from topokit.core.linalg import adjugate, determinant, lift_smallest_eigenvalue, squared_norm, trace
from topokit.errors import InputError

Solver = Literal["sylvester", "symmetrized", "commuting"]


def weingarten_map(tangent: Tensor, normal_change: Tensor, solver: Solver = "sylvester") -> Tensor:
    """The linear map that takes steps on the surface to changes of its normal.

    Args:
        tangent: (..., k, 2), offsets of the neighbours in the tangent basis, dp̃.
        normal_change: (..., k, 2), their normals minus the centre's in the same basis, dñ.
        solver: "sylvester" is the best symmetric map (Algorithm 1, in closed form); "symmetrized" is the
            pseudo-inverse followed by (W + Wᵀ)/2; "commuting" assumes that the map commutes with dp̃ᵀdp̃, which is
            only made for its determinant, the paper's shortcut for K.

    Returns:
        (..., 2, 2), in 1/length, symmetric (for "commuting" only where its assumption holds). With outward normals a
        sphere of radius r gives I/r: W is +∇n, the opposite of the paper's `definition of Weingarten map`.
        Differentiable; finite where all neighbours lie on a line or coincide.

    Raises:
        InputError: for an unknown solver.
    """
    radius = squared_norm(tangent.detach()).mean(-1).sqrt()[..., None, None]
    radius = radius.where(radius > 0, 1)
    steps = tangent / radius
    moment = steps.mT @ steps
    size = trace(moment).detach()
    floor = torch.finfo(steps.dtype).eps ** 0.5 * size.where(size > 0, 1)
    moment = lift_smallest_eigenvalue(moment, floor)
    mixed = steps.mT @ normal_change
    if solver == "sylvester":
        return solve_sylvester(moment, mixed + mixed.mT) / radius
    if solver == "symmetrized":
        plain = adjugate(moment) @ mixed / determinant(moment)[..., None, None]
        return (plain + plain.mT) / 2 / radius
    if solver == "commuting":
        return adjugate(moment) @ (mixed + mixed.mT) / (2 * determinant(moment)[..., None, None]) / radius
    raise InputError(f"solver {solver!r} is not known; use 'sylvester', 'symmetrized' or 'commuting'.")


def solve_sylvester(moment: Tensor, mixed: Tensor) -> Tensor:
    """The symmetric W with A W + W A = S for 2×2 symmetric positive definite A.

    W = (det A · S + adj A · S · adj A) / (2 det A · tr A); equal to Algorithm 1, which takes an eigendecomposition.

    Args:
        moment: A, (..., 2, 2).
        mixed: S, (..., 2, 2), symmetric.

    Reference:
        Paper, equation `robustestimationofW` and Algorithm 1.
    """
    size, product = trace(moment)[..., None, None], determinant(moment)[..., None, None]
    opposite = adjugate(moment)
    return (product * mixed + opposite @ mixed @ opposite) / (2 * product * size)
