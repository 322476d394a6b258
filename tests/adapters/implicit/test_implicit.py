"""Functions whose level set is a surface: integers, messages, positions and gradients."""

from __future__ import annotations

import math
import pickle

import pytest
import torch
from torch import Tensor, nn

import topokit as tk
from topokit.adapters.implicit.surface import analytic_curvature
from topokit.core.grid.euler import solid_euler
from topokit.core.grid.field import Field
from topokit.core.implicit.adaptive_grid import dense_grid, refine
from topokit.core.implicit.level_set import ImplicitPoint, area_weighted_starts, implicit_curvature, project
from topokit.core.local.curvature import surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.samples import SurfaceSamples

BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
ROUGH = {"resolution": 128, "n_samples": 2000, "field_resolution": 32}


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
def test_integer_of_functions_that_are_no_distances(f, euler, genus):
    report = tk.from_sdf(f, BOX, **ROUGH).report()
    assert (report.euler, report.genus, report.verdict, report.closed) == (euler, genus, "likely", True)
    assert report.resolution == pytest.approx(2 * 2 / 64)
    assert report.components == len(report.per_component)


def test_hollow_ball_has_a_cavity():
    report = tk.from_sdf(lambda x: (x.norm(dim=1) - 0.6).abs() - 0.2, BOX, **ROUGH).report()
    assert (report.components, report.cavities, report.betti) == (2, 1, (2, 0, 2))


def test_occupancy_is_the_other_way_round():
    shape = tk.from_occupancy(lambda x: torch.sigmoid(-20 * torus(x)), 0.5, BOX, **ROUGH)
    assert shape.report().euler == 0
    outward = (shape.samples.normals * shape.samples.points).sum(1)
    assert float(outward.mean()) > 0.1


def test_hard_occupancy_without_a_gradient():
    shape = tk.from_occupancy(lambda x: (x.norm(dim=1) < 0.5).float(), 0.5, BOX, **ROUGH)
    assert shape.report().euler == 2
    assert float((shape.samples.points.norm(dim=1) - 0.5).abs().max()) < 1e-5


def test_only_a_part_of_the_grid_is_evaluated_and_nothing_changes():
    def bumpy(x: Tensor) -> Tensor:
        return -(torus(x) + 0.05 * torch.sin(9 * x).prod(dim=1)) * 70

    sparse = refine(refine(dense_grid(bumpy, *BOX, 32), bumpy), bumpy)
    full = dense_grid(bumpy, *BOX, 128)
    assert sparse.n_evaluations < 0.35 * sparse.values.numel()
    assert bool(((sparse.values > 0) == (full.values > 0)).all())


def test_surface_is_followed_out_of_the_cells_that_looked_near():
    def spike(x: Tensor) -> Tensor:  # thinner than the coarse step, but joined to what is seen
        return -torch.minimum(ball(x, 0.4), torch.maximum(x[:, 1:].norm(dim=1) - 0.02, (x[:, 0] - 0.7).abs() - 0.3))

    sparse = refine(refine(dense_grid(spike, *BOX, 16), spike), spike)
    full = dense_grid(spike, *BOX, 64)
    assert int(solid_euler(sparse.values)) == int(solid_euler(full.values)) == 1


def test_disagreement_ends_unsure_with_the_values():
    def foam(x: Tensor) -> Tensor:  # bubbles about as large as a cell of the finest grid
        return ball(x, 0.4) + 0.2 * torch.sin(150 * x).prod(dim=1)

    report = tk.from_sdf(foam, BOX, **ROUGH).report()
    assert report.verdict == "unsure"
    assert any("not settled" in reason for reason in report.reasons)


def test_trained_torus():
    torch.manual_seed(0)
    net = nn.Sequential(nn.Linear(3, 64), nn.Softplus(20), nn.Linear(64, 64), nn.Softplus(20), nn.Linear(64, 1))
    optimizer = torch.optim.Adam(net.parameters(), 3e-3)
    for _ in range(400):
        points = 2 * torch.rand(2048, 3) - 1
        loss = (net(points)[:, 0] - torus(points)).abs().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    shape = tk.from_sdf(net, resolution=256)
    report = shape.report()
    assert (report.euler, report.genus, report.verdict) == (0, 1, "likely")
    assert shape.genus() == 1


# bounds and messages


def test_bounds_grow_with_the_surface():
    report = tk.from_sdf(lambda x: ball(x, 5.0), **ROUGH).report()
    assert report.euler == 2
    assert any("[−8, 8]³" in reason for reason in report.reasons)


def test_box_that_cuts_the_surface_is_named():
    report = tk.from_sdf(lambda x: x[:, :2].norm(dim=1) - 0.5, BOX, **ROUGH).report()
    assert (report.verdict, report.closed, report.genus is None) == ("unsure", False, False)
    assert any("z = -1, z = 1" in reason and "x = " not in reason for reason in report.reasons)


@pytest.mark.parametrize(
    ("f", "said"),
    [
        (lambda x: x[:, 0] * 0 + 1, "no level set"),
        (lambda x: x[:, 0] * 0 - 1, "inside"),
        (lambda x: 0.5 - x.norm(dim=1), "inverted"),
        (lambda x: x, r"shape \(5, 3\)"),
        (lambda x: x.sum(), r"shape \(\)"),
        (lambda x: (x[:, 0] - 0.2).sqrt(), "NaN"),
        (lambda x: x.numpy().tolist(), "returns list"),
        (lambda x, y: x, "cannot be called"),
        (7, "got int"),
    ],
)
def test_each_failure_has_its_own_message(f, said):
    with pytest.raises(tk.TopokitError, match=said):
        tk.from_sdf(f, BOX, **ROUGH).report()


@pytest.mark.parametrize("bounds", [((0, 0, 0), (0, 1, 1)), ((0, 0), (1, 1)), "box", ((0, 0, 0), (1, 1, math.inf))])
def test_bounds_are_checked(bounds):
    with pytest.raises(tk.TopokitError, match="bounds"):
        tk.from_sdf(ball, bounds)


@pytest.mark.parametrize("numbers", [{"resolution": 64}, {"n_samples": 20}, {"field_resolution": 2}])
def test_settings_are_checked(numbers):
    with pytest.raises(tk.TopokitError, match=next(iter(numbers))):
        tk.from_sdf(ball, BOX, **numbers)


def test_networks_that_answer_differently_each_time_are_refused():
    net = nn.Sequential(nn.Linear(3, 8), nn.Dropout(0.5), nn.Linear(8, 1))
    with pytest.raises(tk.TopokitError, match=r"Dropout.*eval"):
        tk.from_sdf(net)


def test_progress_is_shown_to_who_waits(monkeypatch, capsys):
    monkeypatch.setattr("topokit.adapters.implicit.progress._PATIENCE", 0.0)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    shape = tk.from_sdf(torus, BOX, **ROUGH)
    shape.report()
    assert "grid of 128 cells" in capsys.readouterr().err
    assert shape.field.function.f is torus


def test_half_precision_is_noted():
    report = tk.from_sdf(network(nn.Softplus(10), torch.bfloat16), BOX, **ROUGH).report()
    assert "bfloat16" in report.reasons[0]


# files


def test_torchscript_and_export_by_path(tmp_path):
    net = network(nn.Softplus(10), torch.float32)
    script, export = tmp_path / "net.pt", tmp_path / "net.pt2"
    torch.jit.save(torch.jit.trace(net, torch.rand(4, 3)), script)
    points = torch.export.Dim("points", min=2)
    torch.export.save(torch.export.export(net, (torch.rand(4, 3),), dynamic_shapes=({0: points},)), export)
    for path in (script, export):
        shape = tk.load(path, resolution=128, n_samples=1000)
        assert (shape.report().euler, shape.name) == (2, path.name)


@pytest.mark.parametrize("save", [torch.save, lambda net, path: path.write_bytes(pickle.dumps(net.state_dict()))])
def test_pickles_are_refused(tmp_path, save):
    save(nn.Linear(3, 1), tmp_path / "net.pt")
    for adapter in (None, "occupancy"):
        with pytest.raises(tk.TopokitError, match="pickle"):
            tk.load(tmp_path / "net.pt", adapter=adapter)


# samples and curvature


def test_samples_are_on_the_surface_and_spread_by_area():
    shape = tk.from_sdf(lambda x: 100 * torus(x), BOX, n_samples=20_000)
    points, normals = shape.samples.points, shape.samples.normals
    assert float(torus(points).abs().max()) < 1e-5
    assert float((normals.norm(dim=1) - 1).abs().max()) < 1e-5
    outer = (points[:, :2].norm(dim=1) > 0.6).double().mean()
    assert float(outer) == pytest.approx(0.5 + 0.25 / 0.6 / math.pi, abs=0.01)  # the area's share, exactly


def test_starts_measure_area():
    x = torch.cartesian_prod(*[torch.linspace(-1, 1, 41, dtype=torch.float64)] * 3)
    values = (0.7 - x.norm(dim=1)).reshape(41, 41, 41)
    starts, normals = area_weighted_starts(values, 5000, (0.05,) * 3, torch.Generator().manual_seed(0))
    centred = starts - 1
    assert float((centred.norm(dim=1) - 0.7).abs().max()) < 0.05  # a step: they are starts
    assert float((centred.mean(0)).abs().max()) < 0.02
    assert float((normals * centred).sum(1).min()) > 0.6


def test_hessian_is_a_second_source_of_curvature():
    shape = tk.from_sdf(lambda x: torus(x.double()) ** 3 + torus(x.double()), BOX, n_samples=20_000)
    gaussian, mean = analytic_curvature(shape)
    tube = torch.atan2(shape.samples.points[:, 2], shape.samples.points[:, :2].norm(dim=1) - 0.6)
    exact = tube.cos() / (0.25 * (0.6 + 0.25 * tube.cos()))
    assert float((gaussian - exact).abs().max()) < 2e-3
    local = shape.curvature()
    assert float((local.gaussian - gaussian).abs().median()) < 0.1
    assert float((local.mean - mean).abs().median()) < 0.03


def test_implicit_curvature_of_a_sphere():
    at = torch.tensor([[0.3, 0.4, 1.2]], dtype=torch.float64)  # radius 1.3
    gaussian, mean = implicit_curvature(2 * at, 2 * torch.eye(3, dtype=torch.float64)[None])
    assert float(gaussian) == pytest.approx(1 / 1.3**2)
    assert float(mean) == pytest.approx(1 / 1.3)


def test_projection_survives_steps_and_kinks():
    def step(x: Tensor) -> tuple[Tensor, Tensor]:
        return (x[:, 0] > 0.1).double() - 0.5, torch.zeros_like(x)

    starts = torch.tensor([[0.12, 0.3, 0.4]], dtype=torch.float64)
    points, is_on = project(step, starts, torch.tensor([[1.0, 0, 0]], dtype=torch.float64), 0.1)
    assert bool(is_on.all())
    assert float(points[0, 0]) == pytest.approx(0.1)


# derivatives


def test_implicit_point_gradcheck():
    generator = torch.Generator().manual_seed(0)
    value = torch.zeros(4, dtype=torch.float64, requires_grad=True)
    point, gradient = torch.randn(2, 4, 3, generator=generator, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda v: ImplicitPoint.apply(v, point, gradient), (value,))


def test_moved_points_follow_the_weights_gradcheck():
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
        return ImplicitPoint.apply(f(x, weights), x, slope(x, weights))

    assert torch.autograd.gradcheck(moved, (at,))


@pytest.mark.parametrize("activation", [nn.Softplus(10), Sine(), nn.Tanh()])
def test_field_gradient_in_the_weights_gradcheck(activation):
    net = network(activation, width=4)
    names, weights = zip(*net.named_parameters(), strict=True)

    def euler(*values: Tensor) -> Tensor:
        function = lambda x: torch.func.functional_call(net, dict(zip(names, values, strict=True)), (x,))  # noqa: E731
        return tk.from_sdf(lambda x: function(x.double()), BOX, field_resolution=8).euler(method="field", tau=0.1)

    assert torch.autograd.gradcheck(euler, tuple(w.detach().requires_grad_(True) for w in weights))


def test_field_euler_is_that_of_the_whole_grid():
    field = tk.from_sdf(network(nn.Softplus(10)), BOX, field_resolution=20).field
    whole = Field.smoothed_euler(field, 0.05)
    sparse = field.smoothed_euler(0.05)
    assert float(sparse) == pytest.approx(float(whole), abs=1e-9)
    weights = list(field.function.f.parameters())
    for one, other in zip(torch.autograd.grad(whole, weights), torch.autograd.grad(sparse, weights), strict=True):
        torch.testing.assert_close(one, other)


def test_gauss_bonnet_gradient_against_differences_of_the_same_feet():
    """χ⁽⁰⁾ with every sample moved along its own normal to the zero of the changed network, neighbours unchanged."""
    net = network(nn.Softplus(10))
    shape = tk.from_sdf(net, BOX, n_samples=600)
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


@pytest.mark.parametrize("method", ["gauss-bonnet", "field"])
@pytest.mark.parametrize("activation", [nn.ReLU(), Sine(), nn.Softplus(100)])
def test_gradients_are_finite(activation, method):
    net = network(activation, torch.float32)
    tau = 0.1 if method == "field" else None  # the only critical point, the maximum, is too deep for the default
    tk.from_sdf(net, BOX, **ROUGH).euler(method=method, tau=tau).backward()
    grads = [weight.grad for weight in net.parameters() if weight.grad is not None]
    assert grads
    assert all(bool(grad.isfinite().all()) for grad in grads)
    assert any(bool((grad != 0).any()) for grad in grads)


@pytest.mark.parametrize("method", ["gauss-bonnet", "field"])
def test_gradient_of_a_plain_function(method):
    radius = torch.tensor(0.25, requires_grad=True)
    value = tk.from_sdf(lambda x: torus(x, minor=radius), BOX, **ROUGH).euler(method=method)
    value.backward()
    assert bool(radius.grad.isfinite())


def test_report_first_does_not_lose_the_gradient():
    net = network(nn.Softplus(10), torch.float32)
    shape = tk.from_sdf(net, BOX, **ROUGH)
    shape.report()
    assert shape.euler().requires_grad


def test_tau_zero_is_the_integer_and_the_default_is_near():
    shape = tk.from_sdf(torus, BOX, **ROUGH)
    assert int(shape.euler(method="field", tau=0)) == 0
    assert abs(float(shape.euler(method="field"))) < 0.5


def test_method_is_checked():
    shape = tk.from_sdf(torus, BOX, **ROUGH)
    for wrong in ({"method": "persistence"}, {"tau": 0.1}, {"method": "field", "tau": -1.0}):
        with pytest.raises(tk.TopokitError):
            shape.euler(**wrong)


def test_same_generator_same_samples():
    one, other = (
        tk.from_sdf(torus, BOX, generator=torch.Generator().manual_seed(3), **ROUGH).samples.points for _ in range(2)
    )
    assert torch.equal(one, other)
