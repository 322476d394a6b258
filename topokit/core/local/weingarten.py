"""The Weingarten map from neighbors and their normals by least squares (paper, Section II-B)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import torch
from torch import Tensor

from topokit.core.linalg import adjugate, determinant, lift_smallest_eigenvalue, squared_norm, trace
from topokit.errors import InputError

Solver = Literal["sylvester", "symmetrized", "plain", "commuting"]


def weingarten_map(tangent: Tensor, normal_change: Tensor, solver: Solver = "sylvester") -> Tensor:
    """The linear map W that takes steps on the surface to changes of its normal, dñ ≈ dp̃ W.

    Args:
        tangent: (..., k, 2), offsets of the neighbors in the tangent basis, dp̃.
        normal_change: (..., k, 2), their normals minus the center's in the same basis, dñ.
        solver: a key of `SOLVERS`. "sylvester" is the best symmetric map (Algorithm 1); "symmetrized" the symmetric
            part of the pseudo-inverse solution; "plain" that solution itself, for ablations; "commuting" the paper's
            shortcut for K, of which only the determinant is meant.

    Returns:
        (..., 2, 2), in 1/length; symmetric for "sylvester" and "symmetrized". With outward normals a sphere of radius r
        gives I/r: W is +∇n, the opposite of the paper's `definition of Weingarten map`. Differentiable; finite where
        all neighbors lie on a line or coincide.

    Raises:
        InputError: for an unknown solver.
    """
    if solver not in SOLVERS:
        known = ", ".join(repr(name) for name in SOLVERS)
        raise InputError(f"solver {solver!r} is unknown; expected one of {known}.")
    radius = squared_norm(tangent.detach()).mean(-1).sqrt()[..., None, None]
    radius = radius.where(radius > 0, 1)
    steps = tangent / radius
    moment = steps.mT @ steps
    size = trace(moment).detach()
    floor = torch.finfo(steps.dtype).eps ** 0.5 * size.where(size > 0, 1)
    moment = lift_smallest_eigenvalue(moment, floor)
    return SOLVERS[solver](moment, steps.mT @ normal_change) / radius


def solve_sylvester(moment: Tensor, mixed: Tensor) -> Tensor:
    """The symmetric W with A W + W A = S, where S = X + Xᵀ, without an eigendecomposition.

    W = (det A · S + adj A · S · adj A) / (2 det A · tr A); equal to Algorithm 1.

    Args:
        moment: A = dp̃ᵀ dp̃, (..., 2, 2), symmetric positive definite.
        mixed: X = dp̃ᵀ dñ, (..., 2, 2).

    Reference:
        Paper, equation `robustestimationofW` and Algorithm 1.
    """
    both = mixed + mixed.mT
    size, product = trace(moment)[..., None, None], determinant(moment)[..., None, None]
    opposite = adjugate(moment)
    return (product * both + opposite @ both @ opposite) / (2 * product * size)


def solve_plain(moment: Tensor, mixed: Tensor) -> Tensor:
    """The least-squares map W = A⁻¹ X = dp̃⁺ dñ, not symmetric on noisy data. Arguments as for `solve_sylvester`."""
    return adjugate(moment) @ mixed / determinant(moment)[..., None, None]


def solve_symmetrized(moment: Tensor, mixed: Tensor) -> Tensor:
    """(W + Wᵀ)/2 of the least-squares map W = A⁻¹ X. Arguments as for `solve_sylvester`."""
    plain = solve_plain(moment, mixed)
    return (plain + plain.mT) / 2


def solve_commuting(moment: Tensor, mixed: Tensor) -> Tensor:
    """½ A⁻¹ (X + Xᵀ), which solves the Sylvester equation if W and A commute; det W = det(X + Xᵀ) / (4 det A).

    Arguments as for `solve_sylvester`. Symmetric only where its assumption holds.
    """
    return solve_plain(moment, mixed + mixed.mT) / 2


SOLVERS: dict[Solver, Callable[[Tensor, Tensor], Tensor]] = {
    "sylvester": solve_sylvester,
    "symmetrized": solve_symmetrized,
    "plain": solve_plain,
    "commuting": solve_commuting,
}
