"""The closed form against Algorithm 1 written with an eigendecomposition, and the other solvers."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

from topokit.core.local.weingarten import SOLVERS, Solver, solve_sylvester, weingarten_map
from topokit.errors import InputError


def algorithm_1(moment: Tensor, mixed: Tensor) -> Tensor:
    """The paper's Algorithm 1, step by step."""
    values, vectors = torch.linalg.eigh(moment)
    turned = vectors.mT @ mixed @ vectors
    divided = turned / (values[..., :, None] + values[..., None, :])
    return vectors @ divided @ vectors.mT


def random_problem(generator: torch.Generator, n: int = 500) -> tuple[Tensor, Tensor]:
    tangent = torch.randn(n, 12, 2, generator=generator, dtype=torch.float64)
    change = torch.randn(n, 12, 2, generator=generator, dtype=torch.float64)
    return tangent, change


def test_closed_form_is_algorithm_1(generator: torch.Generator) -> None:
    tangent, change = random_problem(generator)
    mixed = tangent.mT @ change
    moment = tangent.mT @ tangent
    expected = algorithm_1(moment, mixed + mixed.mT)
    assert float((solve_sylvester(moment, mixed) - expected).abs().max()) < 1e-10
    assert float((weingarten_map(tangent, change) - expected).abs().max()) < 1e-10


def test_it_is_the_best_symmetric_map(generator: torch.Generator) -> None:
    tangent, change = random_problem(generator, 20)
    best = weingarten_map(tangent, change)

    def misfit(matrix: Tensor) -> Tensor:
        return (tangent @ matrix - change).square().sum((-2, -1))

    for step in torch.randn(50, 2, 2, generator=generator, dtype=torch.float64):
        assert (misfit(best + 1e-3 * (step + step.mT)) > misfit(best)).all()


def test_symmetrized_is_the_pseudo_inverse_made_symmetric(generator: torch.Generator) -> None:
    tangent, change = random_problem(generator, 50)
    plain = torch.linalg.lstsq(tangent, change).solution
    torch.testing.assert_close(weingarten_map(tangent, change, "symmetrized"), (plain + plain.mT) / 2)


def test_plain_is_the_pseudo_inverse_and_not_symmetric_on_noise(generator: torch.Generator) -> None:
    tangent, change = random_problem(generator, 50)
    found = weingarten_map(tangent, change, "plain")
    torch.testing.assert_close(found, torch.linalg.lstsq(tangent, change).solution)
    assert float((found - found.mT).abs().amax((-2, -1)).min()) > 1e-4


@pytest.mark.parametrize("solver", ["sylvester", "symmetrized", "plain"])
def test_quadrics_are_recovered_exactly(solver: Solver, generator: torch.Generator) -> None:
    """The normals of a quadric change by its Hessian times the step, so every solver must find the Hessian."""
    tangent, _ = random_problem(generator, 50)
    hessian = torch.tensor([[1.3, -0.4], [-0.4, 0.2]], dtype=torch.float64)
    found = weingarten_map(tangent, tangent @ hessian, solver)
    torch.testing.assert_close(found, hessian.expand(50, 2, 2))


def test_commuting_has_the_papers_determinant(generator: torch.Generator) -> None:
    tangent, change = random_problem(generator, 50)
    mixed = tangent.mT @ change
    moment, both = tangent.mT @ tangent, mixed + mixed.mT
    shortcut = torch.linalg.det(both) / (4 * torch.linalg.det(moment))
    torch.testing.assert_close(torch.linalg.det(weingarten_map(tangent, change, "commuting")), shortcut)


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_exact_linear_map_is_recovered(solver: Solver, generator: torch.Generator) -> None:
    tangent, _ = random_problem(generator, 20)
    isotropic = torch.tensor([[0.7, 0.0], [0.0, 0.7]], dtype=torch.float64)
    found = weingarten_map(tangent, tangent @ isotropic, solver)
    torch.testing.assert_close(found, isotropic.expand(20, 2, 2))


@pytest.mark.parametrize("solver", SOLVERS)
def test_gradcheck(solver: Solver, generator: torch.Generator) -> None:
    tangent, change = random_problem(generator, 4)
    inputs = (tangent.requires_grad_(), change.requires_grad_())
    assert gradcheck(lambda a, b: weingarten_map(a, b, solver), inputs)


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_lines_and_single_points_stay_finite(scale: float) -> None:
    line = torch.linspace(-1, 1, 9, dtype=torch.float64)[:, None] * torch.tensor([1.0, 0.5], dtype=torch.float64)
    for tangent in (line * scale, torch.zeros(9, 2, dtype=torch.float64)):
        tangent = tangent.clone().requires_grad_()
        found = weingarten_map(tangent, torch.ones(9, 2, dtype=torch.float64))
        found.sum().backward()
        assert found.isfinite().all()
        assert tangent.grad is not None
        assert tangent.grad.isfinite().all()


def test_unknown_solver_is_named() -> None:
    with pytest.raises(
        InputError, match="solver 'magic' is unknown; expected one of 'sylvester', 'symmetrized', 'plain', 'commuting'"
    ):
        weingarten_map(torch.ones(4, 2), torch.ones(4, 2), "magic")  # type: ignore[arg-type]
