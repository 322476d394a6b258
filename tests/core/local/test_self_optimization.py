"""Self-optimization: the integrity well, both kinds of steps, what they reach and what they do not change."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch.autograd import gradcheck

import topokit as tk
from topokit.core.local.curvature import CurvatureSettings, surface_curvature
from topokit.core.local.descent import Variable, integrity_well
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.local.self_optimization import Outcome, Refinement, Step, corrected, self_optimize
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError
from topokit.testing import (
    AnalyticSamples,
    as_on_accelerator,
    count_host_visits,
    ellipsoid_samples,
    sphere_samples,
    torus_samples,
)

TORUS = torus_samples(3000)
PLAIN = SurfaceSamples(TORUS.points)
PAPER = CurvatureSettings(normal_method="pca")


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
    assert found.outcome is Outcome.REACHED
    assert found.error == abs(float(found.history[-1]) - target)
    assert found.reason.startswith("Reached the target")
    assert 0 < found.mean_turn < 0.2


def test_without_a_target_the_nearest_even_integer_is_taken() -> None:
    assert float(self_optimize(PLAIN).target) == 0
    assert float(self_optimize(SurfaceSamples(sphere_samples(2000).points)).target) == 2


@pytest.mark.parametrize(
    ("make", "target"),
    [
        (torus_samples, 0.0),
        *(pytest.param(make, 2.0, marks=pytest.mark.long) for make in (sphere_samples, ellipsoid_samples)),
    ],
)
def test_plain_descent_of_the_paper_reaches_the_target(make: Callable[[int], AnalyticSamples], target: float) -> None:
    samples = SurfaceSamples(make(1000).points)
    found = self_optimize(samples, target, settings=PAPER, step="gradient", tolerance=5e-3)
    assert abs(float(found.history[0]) - target) > 0.05
    assert found.converged
    assert found.error < 5e-3
    assert 20 < found.steps < 200
    assert found.mean_turn < 0.02


def test_plain_descent_stays_in_the_well_next_to_its_start() -> None:
    """Between the start, 0.21, and the target −4 lies the hill of w_int at −1, steeper than |χ − χ*| is."""
    samples = SurfaceSamples(torus_samples(500).points)
    found = self_optimize(samples, -4.0, settings=PAPER, step="gradient", max_steps=40)
    assert not found.converged
    assert float(found.history.min()) > -1


@pytest.mark.parametrize("over", [("points",), ("areas",), ("normals", "points", "areas")])
def test_points_and_areas_can_be_refined_too(over: tuple[Variable, ...]) -> None:
    found = self_optimize(PLAIN, 0.0, over=over)
    assert found.converged
    assert set(found.corrections) == set(over)
    moved = (found.samples.points - TORUS.points).norm(dim=-1)
    spacing = (TORUS.area / 3000) ** 0.5
    assert (float(moved.max()) > 0) == ("points" in over)
    assert float(moved.mean()) < 0.2 * spacing
    if "areas" in over:
        assert found.samples.areas is not None
        assert float((found.corrections["areas"] - 1).abs().max()) < 0.5
        assert float(found.samples.areas.sum()) == pytest.approx(TORUS.area, rel=0.05)


@pytest.mark.parametrize(
    "settings",
    [
        CurvatureSettings(n_neighbors=10),
        CurvatureSettings(solver="plain"),
        CurvatureSettings(solver="symmetrized"),
        CurvatureSettings(area_method="monte-carlo", area_resolution=16),
    ],
)
def test_every_setting_is_used(settings: CurvatureSettings) -> None:
    start = SurfaceSamples(TORUS.points[:800])
    local = surface_curvature(start, settings)
    found = self_optimize(start, 0.0, settings=settings)
    torch.testing.assert_close(found.history[0], euler_characteristic(local.gaussian, local.area))
    assert found.converged
    after = surface_curvature(found.samples, settings, neighbors=local.neighbors)
    assert abs(float(euler_characteristic(after.gaussian, after.area))) < 1e-3


def test_corrections_reproduce_the_refined_samples() -> None:
    start = SurfaceSamples(TORUS.points, TORUS.normals)
    found = self_optimize(start, -1.0)
    again = corrected(start, found, areas=torch.zeros(3000))
    assert again.areas is None
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


def test_a_target_out_of_reach_is_reported() -> None:
    found = self_optimize(PLAIN, -500.0, max_steps=2)
    assert found.outcome is Outcome.OUT_OF_STEPS
    assert not found.converged
    assert found.reason.startswith("Stopped after 2 steps, still")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"over": ("weights",)}, "over must name some of"),
        ({"over": ()}, "over must"),
        ({"step": "newton"}, "'newton' is unknown"),
    ],
)
def test_unknown_options_are_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        self_optimize(PLAIN, **options)


@pytest.mark.parametrize(
    ("step", "target", "tolerance", "reached"),
    [("polyak", 0.0, 1e-3, True), ("polyak", -500.0, 1e-3, False), ("gradient", 0.0, 0.33, True)],
)
def test_when_the_host_looks_changes_no_digit(step: Step, target: float, tolerance: float, reached: bool) -> None:
    start = SurfaceSamples(torus_samples(300).points)

    def refined(look_every: int) -> Refinement:
        return self_optimize(start, target, step=step, tolerance=tolerance, max_steps=6, look_every=look_every)

    one = refined(1)
    assert one.converged == reached
    assert (one.steps < 6) == reached
    for other in (refined(5), refined(100)):
        assert (other.steps, other.error, other.mean_turn) == (one.steps, one.error, one.mean_turn)
        assert torch.equal(other.history, one.history)
        assert torch.equal(other.corrections["normals"], one.corrections["normals"])


@pytest.mark.parametrize("step", ["polyak", "gradient"])
def test_no_step_visits_the_host_unless_asked(step: Step) -> None:
    known = torus_samples(400)
    start = SurfaceSamples(known.points, known.normals)
    here = self_optimize(start, -1.0, step=step, max_steps=6)
    with as_on_accelerator():
        with count_host_visits() as visits:
            there = self_optimize(start, -1.0, step=step, max_steps=6)
        assert len(visits) == 0, str(visits)
        with count_host_visits() as visits:
            self_optimize(start, -500.0, step=step, max_steps=6, look_every=2)
        assert len(visits) == 3, str(visits)
    assert there.steps == here.steps
    torch.testing.assert_close(there.history, here.history)
    torch.testing.assert_close(there.corrections, here.corrections, rtol=1e-6, atol=1e-6)


def test_refined_euler_of_oriented_samples_stays_on_the_device_without_boundary() -> None:
    known = torus_samples(300)
    with as_on_accelerator():
        shape = tk.from_points(torch.stack((known.points,) * 2).requires_grad_(), torch.stack((known.normals,) * 2))
        with count_host_visits() as visits:
            value = shape.refined_euler(0.0, 20, max_steps=3, boundary=False)
            value.sum().backward()
        assert len(visits) == 0, str(visits)
        counts = []
        for max_steps in (1, 4):  # the boundary and outward signs are found once, however many steps follow
            cloud = tk.from_points(known.points)
            with count_host_visits() as visits:
                cloud.refined_euler(-3.0, max_steps=max_steps)
            counts.append(len(visits))
    assert value.detach().abs().max() < 1e-3
    assert counts[0] == counts[1] > 0


@pytest.mark.parametrize("look_every", [0, -1, 2.5])
def test_looks_are_counted_in_steps(look_every: Any) -> None:
    with pytest.raises(InputError, match="look_every must be an integer of at least 1"):
        self_optimize(PLAIN, 0.0, look_every=look_every)


def test_refined_euler_meets_the_target_with_the_gradient_of_the_plain_sum() -> None:
    points = TORUS.points.clone().requires_grad_()
    shape = tk.from_points(points, TORUS.normals)
    plain, refined = shape.gauss_bonnet(), shape.refined_euler(0.0, tolerance=1e-5)
    assert abs(float(refined.detach())) < 1e-5
    assert 1e-4 < abs(float(plain.detach())) < 0.2
    (with_refined,) = torch.autograd.grad(refined, points)
    (without,) = torch.autograd.grad(plain, points)
    cosine = torch.nn.functional.cosine_similarity(with_refined.ravel(), without.ravel(), dim=0)
    assert float(cosine) > 0.9
    assert abs(float(shape.refined_euler(-4.0)) + 4) < 1e-3


def test_every_option_of_refined_euler_reaches_the_optimization() -> None:
    shape = tk.from_points(torus_samples(600).points)
    assert abs(float(shape.refined_euler(0.0, step="gradient", tolerance=1e-2))) < 1e-2
    assert float(shape.refined_euler(0.0, max_steps=0)) == pytest.approx(float(shape.gauss_bonnet()))
    few, slow = (shape.refined_euler(0.0, step="gradient", max_steps=5, learning_rate=rate) for rate in (0.02, 1e-4))
    assert abs(float(few)) < abs(float(slow)) - 0.01
    for options in ({"over": ("areas",)}, {"over": ("points",)}, {"solver": "plain"}, {"area_method": "monte-carlo"}):
        assert abs(float(shape.refined_euler(0.0, **options))) < 1e-3, options  # type: ignore[arg-type]
    assert abs(float(shape.refined_euler(0.0, 9))) < 1e-3


def test_unoriented_clouds_are_refined_to_the_witness() -> None:
    points = torus_samples(2000).points.requires_grad_()
    value = tk.from_points(points).refined_euler()
    assert abs(float(value.detach())) < 1e-3
    value.backward()
    assert points.grad is not None
    assert points.grad.isfinite().all()
