"""Self-optimisation: the well, the steps, what they reach and what they leave alone."""

from __future__ import annotations

import pytest
import torch
from torch.autograd import gradcheck

import topokit as tk
from topokit.core.local.self_optimization import Refinement, corrected, integrity_well, self_optimize
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError
from topokit.testing import sphere_samples, torus_samples

TORUS = torus_samples(3000)
PLAIN = SurfaceSamples(TORUS.points)


def test_the_well_is_zero_at_even_integers_and_four_at_odd_ones() -> None:
    values = torch.arange(-6.0, 7.0, dtype=torch.float64).requires_grad_()
    well = integrity_well(values)
    torch.testing.assert_close(well, torch.where(values.detach() % 2 == 0, 0.0, 4.0).double())
    assert gradcheck(integrity_well, (values + 0.3,))


@pytest.mark.parametrize("target", [0.0, -2.0])
def test_polyak_reaches_any_target_in_a_few_steps(target: float) -> None:
    found = self_optimize(PLAIN, target, tolerance=1e-4)
    assert found.converged
    assert found.steps <= 5
    assert abs(float(found.history[-1]) - target) < 1e-4
    assert found.reason.startswith("Reached the target")
    assert 0 < found.mean_turn < 0.2


def test_without_a_target_the_nearest_even_integer_is_taken() -> None:
    assert float(self_optimize(PLAIN).target) == 0
    assert float(self_optimize(SurfaceSamples(sphere_samples(2000).points)).target) == 2


def test_plain_gradient_descent_of_the_paper_goes_the_same_way_slowly() -> None:
    start = self_optimize(PLAIN, 0.0, max_steps=0)
    found = self_optimize(PLAIN, 0.0, step="gradient", learning_rate=1e-3, max_steps=15, tolerance=1e-2)
    assert abs(float(found.history[-1])) < abs(float(start.history[0]))


@pytest.mark.parametrize("over", [("points",), ("areas",), ("normals", "points", "areas")])
def test_points_and_areas_can_be_refined_too(over: tuple[str, ...]) -> None:
    found = self_optimize(PLAIN, 0.0, over=over)  # type: ignore[arg-type]
    assert found.converged
    assert set(found.corrections) == set(over)
    moved = (found.samples.points - TORUS.points).norm(dim=-1)
    assert (float(moved.max()) > 0) == ("points" in over)
    if "areas" in over:
        assert found.samples.areas is not None
        assert float(found.samples.areas.min()) >= 0


def test_corrections_reproduce_the_refined_samples() -> None:
    start = SurfaceSamples(TORUS.points, TORUS.normals)
    found = self_optimize(start, -1.0)
    again = corrected(start, found)
    assert again.normals is not None
    torch.testing.assert_close(again.normals, found.samples.normals, atol=1e-12, rtol=0)


def test_batches_are_refined_item_by_item() -> None:
    points = torch.stack((TORUS.points[:1000], sphere_samples(1000).points))
    found = self_optimize(SurfaceSamples(points), torch.tensor([0.0, 2.0]))
    assert found.history.shape[1:] == (2,)
    assert float((found.history[-1] - found.target).abs().max()) < 1e-3


def test_nothing_moves_when_there_is_nothing_to_do() -> None:
    sphere = sphere_samples(1000)
    start = SurfaceSamples(sphere.points, sphere.normals)
    value = float(self_optimize(start, max_steps=0).history[0])
    found: Refinement = self_optimize(start, value)
    assert (found.steps, found.mean_turn) == (0, 0.0)


def test_a_target_out_of_reach_is_said() -> None:
    found = self_optimize(PLAIN, -500.0, max_steps=2)
    assert not found.converged
    assert found.reason.startswith("Stopped after 2 steps, still")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"over": ("weights",)}, "over must name some of"),
        ({"over": ()}, "over must"),
        ({"step": "newton"}, "'newton' is not"),
    ],
)
def test_unknown_options_are_named(options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        self_optimize(PLAIN, **options)


def test_euler_is_the_refined_value_with_the_formulas_gradient() -> None:
    points = TORUS.points.clone().requires_grad_()
    shape = tk.from_points(points, TORUS.normals)
    plain, refined = shape.euler(), shape.euler()
    assert abs(float(refined.detach())) < 1e-3
    assert abs(float(plain.detach())) < 0.2
    (with_refined,) = torch.autograd.grad(refined, points)
    (without,) = torch.autograd.grad(plain, points)
    cosine = torch.nn.functional.cosine_similarity(with_refined.ravel(), without.ravel(), dim=0)
    assert float(cosine) > 0.9
    assert abs(float(shape.euler(target=-4.0)) + 4) < 1e-3


def test_unoriented_clouds_are_refined_to_the_witness() -> None:
    points = torus_samples(4000).points.requires_grad_()
    value = tk.from_points(points).euler()
    assert abs(float(value.detach())) < 1e-3
    value.backward()
    assert points.grad is not None
    assert points.grad.isfinite().all()
