"""Functions whose level set is a surface: integers, messages, positions and gradients."""

from __future__ import annotations

import copy
import inspect
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

import topokit as tk
from topokit.core.grid.euler import smoothed_euler, solid_euler
from topokit.core.grid.grid import Grid
from topokit.core.implicit.adaptive_grid import AdaptiveField, Evaluate, dense_field, grid_stages, refine_grid
from topokit.core.implicit.convergence import convergence_study
from topokit.core.implicit.level_set import area_weighted_starts, implicit_point, project
from topokit.core.local.curvature import surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.progress import listening, stages
from topokit.core.samples import SurfaceSamples

BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
ROUGH: dict[str, Any] = {"resolution": 128, "n_samples": 2000, "field_resolution": 32}

Function = Callable[[Tensor], Tensor]


def torus(x: Tensor, major: float = 0.6, minor: float = 0.25) -> Tensor:
    return torch.stack((x[:, :2].norm(dim=1) - major, x[:, 2]), dim=1).norm(dim=1) - minor


def ball(x: Tensor, radius: float = 0.7) -> Tensor:
    return x.norm(dim=1) - radius


class Sine(nn.Module):
    def forward(self, x: Tensor) -> Tensor:
        return torch.sin(3 * x)


def network(activation: nn.Module, dtype: torch.dtype = torch.float64, width: int = 16) -> nn.Module:
    """A network whose zero set is a bumpy ball: a small random part added to a large round one."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        inner = nn.Sequential(nn.Linear(3, width), activation, nn.Linear(width, 1))

    class Bumpy(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.inner = inner

        def forward(self, x: Tensor) -> Tensor:
            return (x.norm(dim=1) - 0.6)[:, None] + 0.1 * self.inner(x)

    return Bumpy().to(dtype)


# integers


@pytest.mark.parametrize(
    ("f", "euler", "genus"),
    [
        (ball, 2, 0),
        (torus, 0, 1),
        (lambda x: torus(x)[:, None], 0, 1),
        (lambda x: 5000 * torus(x) ** 3 + 5000 * torus(x), 0, 1),
        (lambda x: (x.norm(dim=1) - 0.6).abs() - 0.2, 4, 0),
        (lambda x: torch.minimum(ball(x - 0.5, 0.3), ball(x + 0.5, 0.3)), 4, 0),
    ],
)
def test_integer_of_functions_that_are_no_distances(f: Function, euler: int, genus: int) -> None:
    shape = tk.from_sdf(f, bounds=BOX, **ROUGH)
    report = shape.report(certify=False)
    assert (report.euler, report.genus, report.verdict, report.closed) == (euler, genus, "likely", True)
    assert report.resolution == pytest.approx(2 * 2 / 32)
    assert report.components == len(report.per_component)


def test_hollow_ball_has_a_cavity() -> None:
    report = tk.from_sdf(lambda x: (x.norm(dim=1) - 0.6).abs() - 0.2, bounds=BOX, **ROUGH).report()
    assert (report.components, report.cavities, report.surface_betti) == (2, 1, (2, 0, 2))


def test_occupancy_is_the_other_way_round() -> None:
    shape = tk.from_occupancy(lambda x: torch.sigmoid(-20 * torus(x)), bounds=BOX, **ROUGH)
    assert shape.report().euler == 0
    outward = (shape.samples.normals * shape.samples.points).sum(1)
    assert float(outward.mean()) > 0.1


def test_hard_occupancy_without_a_gradient() -> None:
    shape = tk.from_occupancy(lambda x: (x.norm(dim=1) < 0.5).float(), bounds=BOX, **ROUGH)
    assert shape.report().euler == 2
    assert float((shape.samples.points.norm(dim=1) - 0.5).abs().max()) < 1e-5


def refined_and_full(f: Evaluate, n_cells: int) -> tuple[AdaptiveField, AdaptiveField]:
    """Two refinements of a grid, and the grid of the same step evaluated at every vertex."""
    coarse = dense_field(f, Grid.covering(*BOX, n_cells))
    fine = refine_grid(refine_grid(coarse, f).field, f).field
    return fine, dense_field(f, Grid.covering(*BOX, 4 * n_cells))


def test_only_a_part_of_the_grid_is_evaluated_and_nothing_changes() -> None:
    def bumpy(x: Tensor) -> Tensor:
        return -(torus(x) + 0.05 * torch.sin(9 * x).prod(dim=1)) * 70

    sparse, full = refined_and_full(bumpy, 32)
    assert sparse.n_evaluations < 0.35 * sparse.values.numel()
    assert bool(((sparse.values > 0) == (full.values > 0)).all())


def test_surface_is_followed_out_of_the_cells_that_looked_near() -> None:
    def spike(x: Tensor) -> Tensor:  # thinner than the coarse step, but joined to what is seen
        return -torch.minimum(ball(x, 0.4), torch.maximum(x[:, 1:].norm(dim=1) - 0.02, (x[:, 0] - 0.7).abs() - 0.3))

    sparse, full = refined_and_full(spike, 16)
    assert int(solid_euler(sparse.values)) == int(solid_euler(full.values)) == 1


def test_disagreement_ends_unsure_with_the_values() -> None:
    def foam(x: Tensor) -> Tensor:  # bubbles about as large as a cell of the finest grid
        return ball(x, 0.4) + 0.2 * torch.sin(150 * x).prod(dim=1)

    report = tk.from_sdf(foam, bounds=BOX, **ROUGH).report()
    assert report.verdict == "unsure"
    assert any("not settled" in reason for reason in report.reasons)


def test_convergence_needs_agreement_of_grids_connectivities_and_shifted_levels() -> None:
    def study(f: Evaluate) -> Any:
        return convergence_study(dense_field(f, Grid.covering(*BOX, 16)), f, 64)

    clear = study(lambda x: -torus(x))
    assert [count.n_cells for count in clear.counts] == [16, 32, 64]
    assert [(count.euler_26, count.euler_6) for count in clear.counts] == [(0, 0)] * 3
    assert (clear.euler, clear.has_converged, set(clear.shifted_eulers)) == (0, True, {0})
    assert (clear.shown.n_cells, clear.finest.n_vertices) == (16, 65**3)

    def grazing(x: Tensor) -> Tensor:  # a second ball, whose top is a fiftieth of a cell above the level
        return torch.maximum(0.4 - x.norm(dim=1), 0.02 / 32 - (x - 0.75).norm(dim=1))

    barely = study(grazing)
    assert [(count.euler_26, count.euler_6) for count in barely.counts] == [(4, 4)] * 3
    assert (barely.euler, barely.has_converged, set(barely.shifted_eulers)) == (4, False, {2, 4})


def test_trained_torus() -> None:
    torch.manual_seed(0)
    net = nn.Sequential(nn.Linear(3, 64), nn.Softplus(20), nn.Linear(64, 64), nn.Softplus(20), nn.Linear(64, 1))
    optimizer = torch.optim.Adam(net.parameters(), 3e-3)
    for _ in range(400):
        points = 2 * torch.rand(1024, 3) - 1
        loss = (net(points)[:, 0] - torus(points)).abs().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    shape = tk.from_sdf(net, resolution=128)
    report = shape.report()
    assert (report.euler, report.genus, report.verdict) == (0, 1, "likely")
    assert shape.genus() == 1


# bounds and messages


def test_bounds_grow_with_the_surface() -> None:
    report = tk.from_sdf(lambda x: ball(x, 5.0), **ROUGH).report()
    assert report.euler == 2
    assert any("[−8, 8]³" in reason for reason in report.reasons)


def test_box_that_cuts_the_surface_is_named() -> None:
    report = tk.from_sdf(lambda x: x[:, :2].norm(dim=1) - 0.5, bounds=BOX, **ROUGH).report()
    assert (report.verdict, report.closed, report.genus is None) == ("unsure", False, False)
    assert any("z = -1, z = 1" in reason and "x = " not in reason for reason in report.reasons)
    assert "bounds" in report.text().splitlines()[-1]


@pytest.mark.parametrize(
    ("f", "said"),
    [
        (lambda x: x[:, 0] * 0 + 1, "no level set"),
        (lambda x: x[:, 0] * 0 - 1, "all of it is inside"),
        (lambda x: 0.5 - x.norm(dim=1), r"looks inverted.* Use from_occupancy\(f, level=0\)"),
        (lambda x: x, r"shape \(5, 3\)"),
        (lambda x: x.sum(), r"shape \(\)"),
        (lambda x: (x[:, 0] - 0.2).sqrt(), "NaN"),
        (lambda x: x.numpy().tolist(), "returns list"),
        (lambda x: x.numpy()[:, 0], r"returns ndarray.*torch\.as_tensor"),
        (lambda x, y: x, "cannot be called"),
        (7, "got int"),
    ],
)
def test_each_failure_has_its_own_message(f: Any, said: str) -> None:
    with pytest.raises(tk.TopokitError, match=said):
        tk.from_sdf(f, bounds=BOX, **ROUGH).report()


def test_two_bounds_are_those_of_a_cube() -> None:
    boxes = [tk.from_sdf(ball, bounds=bounds, **ROUGH).field.grid for bounds in ((-1, 1), BOX)]
    assert boxes[0] == boxes[1]


@pytest.mark.parametrize(
    "bounds", [((0, 0, 0), (0, 1, 1)), ((0, 0), (1, 1)), "box", ((0, 0, 0), (1, 1, math.inf)), (1, -1), (0, 1, 2)]
)
def test_bounds_are_checked(bounds: Any) -> None:
    with pytest.raises(tk.TopokitError, match=r"^bounds "):
        tk.from_sdf(ball, bounds=bounds)


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ({"resolution": 64}, "^resolution is 64; it must be at least 128 cells: .* if coarser grids repeat it"),
        ({"batch_size": 0}, "^batch_size is 0; it must be from 1 to 65536"),
        ({"batch_size": 1 << 17}, "^batch_size is 131072; it must be from 1 to 65536"),
        ({"n_samples": 20}, "^n_samples is 20; it must be larger than n_neighbors"),
        ({"field_resolution": 2}, "^field_resolution is 2; it must be at least 8"),
        ({"level": "0.5"}, "^level must be a finite number, got '0.5'"),
        ({"level": math.nan}, "^level must be a finite number, got nan"),
    ],
)
@pytest.mark.parametrize("make", [tk.from_sdf, tk.from_occupancy])
def test_options_are_checked(make: Callable[..., tk.Shape], option: dict[str, Any], said: str) -> None:
    with pytest.raises(tk.TopokitError, match=said):
        make(ball, bounds=BOX, **option)


def test_both_functions_take_the_same_keywords() -> None:
    sdf, occupancy = (inspect.signature(make).parameters for make in (tk.from_sdf, tk.from_occupancy))
    assert list(sdf) == [name for name in occupancy if name != "logits"]  # distances have none
    for name in list(sdf)[1:]:
        assert sdf[name].kind is occupancy[name].kind is inspect.Parameter.KEYWORD_ONLY
        assert name == "level" or sdf[name].default == occupancy[name].default
    assert (sdf["level"].default, occupancy["level"].default) == (0.0, 0.5)


def test_networks_that_answer_differently_each_time_are_refused() -> None:
    net = nn.Sequential(nn.Linear(3, 8), nn.Dropout(0.5), nn.Linear(8, 1))
    with pytest.raises(tk.TopokitError, match=r"Dropout.*eval"):
        tk.from_sdf(net)


@pytest.mark.parametrize(("is_terminal", "patience"), [(True, 0.0), (True, 1000.0), (False, 0.0)])
def test_progress_is_shown_on_terminals_after_a_while(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], is_terminal: bool, patience: float
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr("topokit.report.progress._PATIENCE", patience)
    monkeypatch.setattr("sys.stderr.isatty", lambda: is_terminal)
    tk.from_sdf(torus, bounds=BOX, **ROUGH).report()
    assert ("sdf: grid of 128 cells" in capsys.readouterr().err) == (is_terminal and patience == 0)


def test_progress_counts_the_points_of_each_grid() -> None:
    heard: list[tuple[str, float]] = []
    with listening(lambda stage, share: heard.append((stage, share))), stages(grid_stages(64, 128)):
        refine_grid(dense_field(torus, Grid.covering(*BOX, 64)), torus)
    assert list(dict(heard)) == ["grid of 64 cells", "grid of 128 cells"]
    shares = [share for _, share in heard]
    assert (shares[0], shares[-1], shares) == (0, 1, sorted(shares))
    assert len(heard) > 6, "several calls on each grid"


def test_half_precision_is_noted() -> None:
    report = tk.from_sdf(network(nn.Softplus(10), torch.bfloat16), bounds=BOX, **ROUGH).report()
    assert any("bfloat16" in reason for reason in report.reasons)


# files


def test_torchscript_and_export_by_path(tmp_path: Path) -> None:
    net = network(nn.Softplus(10), torch.float32)
    script, export = tmp_path / "net.pt", tmp_path / "net.pt2"
    torch.jit.save(torch.jit.trace(net, torch.rand(4, 3)), script)
    points = torch.export.Dim("points", min=2)
    torch.export.save(torch.export.export(net, (torch.rand(4, 3),), dynamic_shapes=({0: points},)), export)
    for path in (script, export):
        shape = tk.load(path, adapter="sdf", resolution=128, n_samples=1000)
        assert (shape.report().euler, shape.name) == (2, path.name)


@pytest.mark.parametrize("save", [torch.save, lambda net, path: path.write_bytes(pickle.dumps(net.state_dict()))])
def test_pickles_are_refused(tmp_path: Path, save: Callable[[nn.Module, Path], None]) -> None:
    save(nn.Linear(3, 1), tmp_path / "net.pt")
    for adapter in (None, "occupancy"):
        with pytest.raises(tk.TopokitError, match="pickle"):
            tk.load(tmp_path / "net.pt", adapter=adapter)


# samples and curvature


def test_samples_are_on_the_surface_and_spread_by_area() -> None:
    shape = tk.from_sdf(lambda x: 100 * torus(x), bounds=BOX, n_samples=20_000)
    points, normals = shape.samples.points, shape.samples.normals
    assert float(torus(points).abs().max()) < 1e-5
    assert float((normals.norm(dim=1) - 1).abs().max()) < 1e-5
    outer = (points[:, :2].norm(dim=1) > 0.6).double().mean()
    assert float(outer) == pytest.approx(0.5 + 0.25 / 0.6 / math.pi, abs=0.01)  # the area's share, exactly


def test_starts_measure_area() -> None:
    x = torch.cartesian_prod(*[torch.linspace(-1, 1, 41, dtype=torch.float64)] * 3)
    values = (0.7 - x.norm(dim=1)).reshape(41, 41, 41)
    grid = Grid((41, 41, 41), (0.05,) * 3, (-1.0,) * 3)
    starts, normals = area_weighted_starts(values, grid, 5000, torch.Generator().manual_seed(0))
    assert float((starts.norm(dim=1) - 0.7).abs().max()) < 0.05  # a step: they are starts
    assert float((starts.mean(0)).abs().max()) < 0.02
    assert float((normals * starts).sum(1).min()) > 0.6


def test_projection_survives_steps_and_kinks() -> None:
    def step(x: Tensor) -> tuple[Tensor, Tensor]:
        return (x[:, 0] > 0.1).double() - 0.5, torch.zeros_like(x)

    starts = torch.tensor([[0.12, 0.3, 0.4]], dtype=torch.float64)
    points, is_on = project(step, starts, torch.tensor([[1.0, 0, 0]], dtype=torch.float64), 0.1)
    assert bool(is_on.all())
    assert float(points[0, 0]) == pytest.approx(0.1)


# derivatives


def test_implicit_points_move_against_the_gradient() -> None:
    generator = torch.Generator().manual_seed(0)
    value = torch.zeros(4, dtype=torch.float64, requires_grad=True)
    point, gradient = torch.randn(2, 4, 3, generator=generator, dtype=torch.float64)
    gradient[3] = 0.0  # where the field is flat the point stays
    point.requires_grad_(True)
    gradient.requires_grad_(True)
    moved = implicit_point(value, point, gradient)
    assert torch.equal(moved, point)
    slopes = torch.autograd.grad(moved.sum(), (value, point, gradient), allow_unused=True)
    torch.testing.assert_close(slopes[0][:3], -(gradient.sum(1) / gradient.square().sum(1))[:3].detach())
    assert (slopes[0][3], slopes[1], slopes[2]) == (0, None, None)
    assert torch.autograd.gradcheck(
        lambda v: implicit_point(v, point, gradient), (value,), check_forward_ad=True, check_batched_grad=True
    )
    single = torch.func.vmap(lambda v, p, g: implicit_point(v[None], p[None], g[None])[0])(value, point, gradient)
    torch.testing.assert_close(single, moved)


def test_moved_points_follow_the_weights_gradcheck() -> None:
    """Against solving again: the zero on each foot's own normal, after the weights have changed."""
    feet = torch.nn.functional.normalize(torch.randn(6, 3, generator=torch.Generator().manual_seed(1)).double(), dim=1)

    def f(x: Tensor, weights: Tensor) -> Tensor:
        return (x.square().sum(1) - weights[0]) * (1 + weights[1] * x[:, 0]) + weights[2] * x[:, 1] * x[:, 2]

    def slope(x: Tensor, weights: Tensor) -> Tensor:
        with torch.enable_grad():
            x = x.detach().requires_grad_(True)
            return torch.autograd.grad(f(x, weights.detach()).sum(), x)[0]

    at = torch.tensor([0.6, 0.1, 0.3], dtype=torch.float64, requires_grad=True)
    starts, _ = project(lambda x: (f(x, at).detach(), slope(x, at)), 0.75 * feet, feet, 1.0)
    lines = torch.nn.functional.normalize(slope(starts, at), dim=1)

    def moved(weights: Tensor) -> Tensor:
        x = starts
        for _ in range(8):
            x = x - lines * (f(x, weights).detach() / (slope(x, weights) * lines).sum(1))[:, None]
        return implicit_point(f(x, weights), x, slope(x, weights))

    assert torch.autograd.gradcheck(moved, (at,))


@pytest.mark.parametrize("activation", [nn.Softplus(10), Sine(), nn.Tanh()])
def test_field_gradient_in_the_weights_gradcheck(activation: nn.Module) -> None:
    net = network(activation, width=4)
    names, weights = zip(*net.named_parameters(), strict=True)

    def euler(*values: Tensor) -> Tensor:
        function = lambda x: torch.func.functional_call(net, dict(zip(names, values, strict=True)), (x,))  # noqa: E731
        shape = tk.from_sdf(lambda x: function(x.double()), bounds=BOX, field_resolution=8)
        return shape.smoothed_euler(0.1)

    assert torch.autograd.gradcheck(euler, tuple(w.detach().requires_grad_(True) for w in weights))


def test_field_euler_is_that_of_the_whole_grid() -> None:
    net = network(nn.Softplus(10))
    field = tk.from_sdf(net, bounds=BOX, field_resolution=20).field
    assert field is not None
    whole = smoothed_euler(field.values(), 0.05, 0.0, field.connectivity)
    sparse = field.smoothed_euler(0.05)
    torch.testing.assert_close(sparse, whole, atol=1e-9, rtol=0)
    weights = list(net.parameters())
    for one, other in zip(torch.autograd.grad(whole, weights), torch.autograd.grad(sparse, weights), strict=True):
        torch.testing.assert_close(one, other)


def test_gauss_bonnet_gradient_against_differences_of_the_same_feet() -> None:
    """χ⁽⁰⁾ with every sample moved along its own normal to the zero of the changed network, neighbors unchanged."""
    net = network(nn.Softplus(10))
    shape = tk.from_sdf(net, bounds=BOX, n_samples=600)
    weight = net.inner[0].weight
    local = shape.curvature()
    found = torch.autograd.grad(euler_characteristic(local.gaussian, local.area), weight)[0]
    feet, lines = shape.samples.points.detach(), shape.samples.normals.detach()

    def value() -> float:
        points = feet.clone()
        for _ in range(6):
            x = points.requires_grad_(True)
            f = net(x)[:, 0]
            slope = torch.autograd.grad(f.sum(), x)[0]
            points = (x - lines * (f / (slope * lines).sum(1))[:, None]).detach()
        x = points.requires_grad_(True)
        slope = torch.autograd.grad(net(x).sum(), x)[0]
        local = surface_curvature(SurfaceSamples(points.detach(), slope.detach()))
        return float(euler_characteristic(local.gaussian, local.area))

    for i, j in ((0, 0), (3, 1), (9, 2)):
        values = []
        for shift in (1e-5, -1e-5):
            with torch.no_grad():
                weight[i, j] += shift
            values.append(value())
            with torch.no_grad():
                weight[i, j] -= shift
        assert float(found[i, j]) == pytest.approx((values[0] - values[1]) / 2e-5, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize(
    "ask", [tk.Shape.euler, lambda shape: shape.smoothed_euler(0.1)], ids=["gauss-bonnet", "field"]
)
@pytest.mark.parametrize("activation", [nn.ReLU(), Sine(), nn.Softplus(100)])
def test_gradients_are_finite(activation: nn.Module, ask: Callable[[tk.Shape], Tensor]) -> None:
    net = network(activation, torch.float32)
    ask(tk.from_sdf(net, bounds=BOX, **ROUGH)).backward()
    grads = [weight.grad for weight in net.parameters() if weight.grad is not None]
    assert grads
    assert all(bool(grad.isfinite().all()) for grad in grads)
    assert any(bool((grad != 0).any()) for grad in grads)


def test_samples_of_a_plain_function_move_with_its_parameters() -> None:
    """The tube of a torus grows outward by as much as its radius: dp/dr = n."""
    radius = torch.tensor(0.25, dtype=torch.float64, requires_grad=True)
    samples = tk.from_sdf(lambda x: torus(x.double(), minor=radius), bounds=BOX, **ROUGH).samples
    outward = (samples.points * samples.normals.detach()).sum()
    assert float(torch.autograd.grad(outward, radius)[0]) == pytest.approx(2000, rel=1e-6)


def test_field_gradient_of_a_plain_function_against_differences() -> None:
    def euler(radius: Tensor) -> Tensor:
        shape = tk.from_sdf(lambda x: torus(x.double(), minor=radius), bounds=BOX, **ROUGH)
        return shape.smoothed_euler(0.1)

    radius = torch.tensor(0.45, dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(euler(radius), radius)
    step = 1e-6
    with torch.no_grad():
        difference = (euler(radius + step) - euler(radius - step)) / (2 * step)
    assert float(slope) == pytest.approx(float(difference), rel=1e-4)
    assert float(slope) > 1  # a thicker torus has a smaller hole


def test_report_first_does_not_lose_the_gradient() -> None:
    net = network(nn.Softplus(10), torch.float32)
    shape = tk.from_sdf(net, bounds=BOX, **ROUGH)
    shape.report()
    assert shape.gauss_bonnet().requires_grad


def test_tau_zero_is_the_integer_and_the_default_is_near() -> None:
    shape = tk.from_sdf(torus, bounds=BOX, **ROUGH)
    assert int(shape.smoothed_euler(0)) == 0
    assert abs(float(shape.smoothed_euler())) < 0.5
    assert float(shape.smoothed_euler()) != 0


def test_tau_is_checked() -> None:
    shape = tk.from_sdf(torus, bounds=BOX, **ROUGH)
    for wrong in (-1.0, float("inf"), float("nan")):
        with pytest.raises(tk.InputError, match="tau must be a positive number"):
            shape.smoothed_euler(wrong)


def test_same_generator_same_samples() -> None:
    def samples(seed: int) -> Tensor:
        return tk.from_sdf(torus, bounds=BOX, generator=torch.Generator().manual_seed(seed), **ROUGH).samples.points

    assert torch.equal(samples(3), samples(3))
    assert not torch.equal(samples(3), samples(4))


# levels


@pytest.mark.parametrize("level", [-0.2, 0.1])
def test_the_surface_lies_on_the_level(level: float) -> None:
    sdf = tk.from_sdf(lambda x: ball(x, 0.5), bounds=BOX, level=level, **ROUGH)
    occupancy = tk.from_occupancy(lambda x: -ball(x, 0.5), bounds=BOX, level=-level, **ROUGH)
    for shape in (sdf, occupancy):
        radii = shape.samples.points.norm(dim=1)
        torch.testing.assert_close(radii, torch.full_like(radii, 0.5 + level))
        assert float((shape.samples.normals * shape.samples.points).sum(1).min()) > 0
        assert shape.report().euler == 2
        assert float(shape.curvature().mean.median()) == pytest.approx(1 / (0.5 + level), rel=0.05)
        low, high = shape.report().per_component[0].bounds
        assert high[0] - low[0] == pytest.approx(2 * (0.5 + level), abs=0.1)
    assert torch.equal(sdf.field.values(), occupancy.field.values())


def test_the_level_decides_the_topology() -> None:
    shapes = {level: tk.from_sdf(torus, bounds=BOX, level=level, **ROUGH) for level in (-0.1, 0.0, 0.37)}
    genera = {level: shape.genus() for level, shape in shapes.items()}
    assert genera == {-0.1: 1, 0.0: 1, 0.37: 0}  # the hole of radius 0.35 is closed
    assert int(shapes[0.37].smoothed_euler(0)) == 2


def test_a_level_moves_the_gradient_too() -> None:
    def euler(level: float, radius: Tensor) -> Tensor:
        shape = tk.from_sdf(lambda x: torus(x.double(), minor=radius), bounds=BOX, level=level, **ROUGH)
        return shape.smoothed_euler(0.1)

    thin, thick = (torch.tensor(r, dtype=torch.float64, requires_grad=True) for r in (0.25, 0.45))
    torch.testing.assert_close(euler(0.2, thin), euler(0.0, thick))
    torch.testing.assert_close(
        torch.autograd.grad(euler(0.2, thin), thin), torch.autograd.grad(euler(0.0, thick), thick)
    )


# compiled networks


def test_compiled_networks_are_reported_and_differentiated() -> None:
    net = network(nn.Softplus(10), torch.float32)
    compiled = torch.compile(net, backend="aot_eager")
    expected = tk.from_sdf(net, bounds=BOX, **ROUGH)
    shape = tk.from_sdf(compiled, bounds=BOX, **ROUGH)
    assert shape.report().euler == expected.report().euler == 2
    torch.testing.assert_close(shape.samples.points, expected.samples.points)
    gradients = [
        torch.autograd.grad(one.curvature().gaussian.sum(), list(net.parameters())) for one in (shape, expected)
    ]
    torch.testing.assert_close(gradients[0], gradients[1], rtol=1e-3, atol=1e-3)
    gradients = [torch.autograd.grad(one.smoothed_euler(0.1), list(net.parameters())) for one in (shape, expected)]
    torch.testing.assert_close(gradients[0], gradients[1])


# randomness


def test_samples_do_not_depend_on_when_they_are_drawn() -> None:
    def shapes() -> tuple[tk.Shape, tk.Shape, torch.Generator]:
        generator = torch.Generator().manual_seed(3)
        one, other = (tk.from_sdf(torus, bounds=BOX, generator=generator, **ROUGH) for _ in range(2))
        return one, other, generator

    first, second, _ = shapes()
    late_first, late_second, generator = shapes()
    torch.rand(7, generator=generator)
    late_second.samples  # noqa: B018
    assert torch.equal(first.samples.points, late_first.samples.points)
    assert torch.equal(second.samples.points, late_second.samples.points)
    assert not torch.equal(first.samples.points, second.samples.points)


# log-odds and latent codes


def test_log_odds_describe_the_surface_of_their_probabilities() -> None:
    def log_odds(x: Tensor) -> Tensor:
        return 8 * (0.6 - x.norm(dim=1))

    for level in (0.5, 0.3):
        odds = tk.from_occupancy(log_odds, logits=True, level=level, bounds=BOX, **ROUGH)
        shares = tk.from_occupancy(lambda x: log_odds(x).sigmoid(), level=level, bounds=BOX, **ROUGH)
        assert odds.field is not None
        assert shares.field is not None
        assert torch.equal(odds.field.values() > 0, shares.field.values() > 0)
    assert odds.report().euler == 2
    for level in (0, 1, -2.0):
        with pytest.raises(tk.InputError, match="probability between 0 and 1"):
            tk.from_occupancy(log_odds, logits=True, level=level, bounds=BOX)


def test_gradients_reach_a_latent_code() -> None:
    decoder = network(nn.Softplus(10), torch.float32)
    code = torch.tensor([0.1, 0.0, -0.1], requires_grad=True)
    shape = tk.from_sdf(lambda x: decoder(x + code.expand(len(x), -1)), bounds=BOX, **ROUGH)
    for value in (shape.smoothed_euler(0.1), tk.EulerLoss(0.0)(shape, 0.1), shape.gauss_bonnet()):
        (slope,) = torch.autograd.grad(value, code)
        assert slope.isfinite().all()
        assert slope.abs().max() > 0


def test_losses_take_compiled_networks() -> None:
    net = network(nn.Softplus(10), torch.float32)
    compiled = torch.compile(net, backend="aot_eager")
    for loss in (tk.EulerLoss(0.0), tk.TopologyLoss(genus=1)):
        found = []
        for one in (net, compiled):
            value = copy.deepcopy(loss)(tk.from_sdf(one, bounds=BOX, field_resolution=16), 0.05)
            found.append((value.detach(), *torch.autograd.grad(value, list(net.parameters()))))
        torch.testing.assert_close(found[1], found[0], rtol=1e-4, atol=1e-5)


def test_a_network_that_was_trained_on_is_not_answered_with_what_was_measured_before() -> None:
    class Ball(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.radius = torch.nn.Parameter(torch.tensor(0.5))

        def forward(self, points: torch.Tensor) -> torch.Tensor:
            return points.norm(dim=1) - self.radius

    ball = Ball()
    shape = tk.from_sdf(ball, bounds=(-1, 1), resolution=128)
    with torch.no_grad():
        ball.radius += 0.1  # nothing has been measured yet
    assert shape.report().euler == shape.report().euler == 2
    with torch.no_grad():
        ball.radius -= 0.1
    with pytest.raises(tk.InputError, match=r"weights of sdf have changed .* topokit\.from_sdf\(net\)"):
        shape.report()
    assert shape.smoothed_euler().isfinite()
    assert tk.from_sdf(ball, bounds=(-1, 1), resolution=128).genus() == 0
