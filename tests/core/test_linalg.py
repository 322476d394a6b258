"""Closed forms against LAPACK, and derivatives where eigenvalues coincide."""

from __future__ import annotations

import pytest
import torch
from torch.autograd import gradcheck

from topokit.core import linalg


def symmetric(n: int, size: int, generator: torch.Generator) -> torch.Tensor:
    matrix = torch.randn(n, size, size, generator=generator, dtype=torch.float64)
    return matrix @ matrix.mT


def test_eigenvalues_and_vectors_are_those_of_lapack(generator: torch.Generator) -> None:
    matrix = symmetric(200, 2, generator)
    values, vectors = torch.linalg.eigh(matrix)
    torch.testing.assert_close(linalg.eigenvalues(matrix), values)
    aligned = (linalg.eigenvectors(matrix) * vectors.mT).sum(-1).abs()
    torch.testing.assert_close(aligned, torch.ones_like(aligned))


def test_adjugate_times_matrix_is_the_determinant(generator: torch.Generator) -> None:
    matrix = torch.randn(50, 2, 2, generator=generator, dtype=torch.float64)
    product = linalg.adjugate(matrix) @ matrix
    torch.testing.assert_close(product, linalg.determinant(matrix)[:, None, None] * torch.eye(2, dtype=torch.float64))
    torch.testing.assert_close(linalg.determinant(matrix), torch.linalg.det(matrix))


def test_smallest_eigenvector_has_the_derivative_of_perturbation_theory(generator: torch.Generator) -> None:
    matrix = symmetric(20, 3, generator)
    matrix = (matrix / linalg.trace(matrix)[:, None, None]).requires_grad_()
    helper = torch.randn(20, 3, generator=generator, dtype=torch.float64)
    reference = torch.linalg.eigh(matrix.detach()).eigenvectors[..., 0]

    def signed(value: torch.Tensor) -> torch.Tensor:
        value = (value + value.mT) / 2
        found = linalg.smallest_eigenvector(value, helper, least_gap=1e-9)
        return found * (found.detach() * reference).sum(-1, keepdim=True).sign()

    assert gradcheck(signed, (matrix,))


@pytest.mark.parametrize(
    "diagonal", [(1.0, 1.0, 1.0), (0.0, 1.0, 1.0), (1.0, 1.0, 2.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)]
)
def test_smallest_eigenvector_gradient_is_finite_at_equal_eigenvalues(diagonal: tuple[float, float, float]) -> None:
    matrix = torch.diag(torch.tensor(diagonal, dtype=torch.float64))[None].requires_grad_()
    linalg.smallest_eigenvector(matrix, torch.ones(1, 3, dtype=torch.float64)).sum().backward()
    assert matrix.grad is not None
    assert matrix.grad.isfinite().all()
    assert matrix.grad.abs().max() <= 1e4


def test_principal_gradients_are_finite_at_umbilics() -> None:
    for matrix in (torch.eye(2), torch.zeros(2, 2), torch.diag(torch.tensor([1.0, 2.0]))):
        matrix = matrix.double()[None].requires_grad_()
        (linalg.eigenvalues(matrix).sum() + linalg.eigenvectors(matrix).sum()).backward()
        assert matrix.grad is not None
        assert matrix.grad.isfinite().all()


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_normalize_keeps_every_scale(scale: float) -> None:
    vectors = torch.tensor([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]]) * scale
    vectors.requires_grad_()
    unit = linalg.normalize(vectors)
    torch.testing.assert_close(unit.detach(), torch.tensor([[0.6, 0.8, 0.0], [0.0, 0.0, 0.0]]))
    unit.sum().backward()
    assert vectors.grad is not None
    assert vectors.grad.isfinite().all() or scale == 1e-30


def test_tangent_basis_is_orthonormal_even_with_a_useless_helper(generator: torch.Generator) -> None:
    normals = linalg.normalize(torch.randn(30, 3, generator=generator, dtype=torch.float64))
    identity = torch.eye(3, dtype=torch.float64).expand(30, 3, 3)
    for helper in (torch.randn(30, 3, generator=generator, dtype=torch.float64), normals, torch.zeros_like(normals)):
        basis = linalg.tangent_basis(normals, helper)
        torch.testing.assert_close(basis @ basis.mT, identity)
        torch.testing.assert_close(torch.linalg.det(basis), torch.ones(30, dtype=torch.float64))
