"""The Euler loss at work: shapes of every kind, and short optimisations judged by marching cubes."""

from __future__ import annotations

import math
import warnings

import pytest
import torch
from analytic_fields import ball, block, grid, meshed_topology, rod, torus, union, without
from splat_writers import torus_scene
from torch import Tensor, nn

import topokit as tk
from topokit.core.grid_components import grid_components
from topokit.errors import InputError
from topokit.testing import torus_samples

DOUBLE = torch.float64


def optimised(start: Tensor, loss: tk.EulerLoss, tau: float, steps: int = 60, rate: float = 0.01) -> Tensor:
    """The field after descent, kept near to where it was."""
    field = start.clone().requires_grad_()
    optimizer = torch.optim.Adam([field], rate)
    for _ in range(steps):
        optimizer.zero_grad()
        (loss(field, tau) + 100 * (field - start).square().mean()).backward()
        optimizer.step()
    return field.detach()


# plain grids


def test_a_torus_becomes_a_ball():
    start = torus(grid(32), 0.5, 0.25).float()
    assert meshed_topology(start) == (1, 0)
    field = optimised(start, tk.EulerLoss(genus=0), tau=0.03)
    assert meshed_topology(field) == (1, 2)
    changed = (field > 0) != (start > 0)
    assert changed.sum() < 0.05 * (start > 0).sum()


P = grid(24)
LINKS = union(torus(P, 0.3, 0.14, (-0.4, 0, 0)), torus(P, 0.3, 0.14, (0.4, 0, 0)))


@pytest.mark.parametrize(
    ("start", "options", "surfaces", "euler"),
    [
        (union(ball(P, 0.33, (-0.42, 0, 0)), ball(P, 0.35, (0.42, 0, 0))), {"genus": 0}, 1, 2),
        (union(ball(P, 0.5, (-0.2, 0, 0)), ball(P, 0.15, (0.65, 0.4, 0.3))), {"genus": 0, "change": "remove"}, 1, 2),
        (without(rod(P, 0.7, 0.3), ball(P, 0.6, (0, 0, 0.75)), ball(P, 0.6, (0, 0, -0.75))), {"genus": 1}, 1, 0),
        (without(ball(P, 0.7), ball(P, 0.25)), {"genus": 0, "change": "add"}, 1, 2),
        (LINKS, {"genus": 2, "components": 2}, 2, 0),
    ],
    ids=["join", "remove", "drill", "fill", "split"],
)
def test_each_kind_of_change_is_reached(start, options, surfaces, euler):
    assert meshed_topology(start) != (surfaces, euler)
    assert meshed_topology(optimised(start, tk.EulerLoss(**options), tau=0.04)) == (surfaces, euler)


def test_each_component_gets_its_own_topology():
    """A dimpled disc and a smaller torus: each may have the hole, the larger being named first."""
    disc = without(rod(P, 0.45, 0.3, center=(-0.5, 0, 0)), *(ball(P, 0.4, (-0.5, 0, z)) for z in (0.5, -0.5)))
    start = union(disc, torus(P, 0.28, 0.12, (0.6, 0, 0)))

    def tunnels_by_size(field: Tensor) -> list[int]:
        return [part.tunnels for part in sorted(grid_components(field)[1], key=lambda part: -part.voxels)]

    assert tunnels_by_size(start) == [0, 1]
    for genus in ((0, 1), (1, 0), (0, 0), (1, 1)):
        field = optimised(start, tk.EulerLoss(genus=genus), tau=0.04)
        assert tunnels_by_size(field) == list(genus)
        assert meshed_topology(field) == (2, 4 - 2 * sum(genus))


def test_parts_are_first_counted_and_then_mended():
    three = union(LINKS, ball(P, 0.12, (0, 0.8, 0.8)))
    field = optimised(three, tk.EulerLoss(genus=(1, 1)), tau=0.04, steps=100)
    assert sorted(part.tunnels for part in grid_components(field)[1]) == [1, 1]


def test_a_module_that_is_reset_starts_anew():
    loss = tk.EulerLoss(genus=0, euler_weight=0.0)
    first, second = torus(P, 0.5, 0.2), without(block(P, (0.8, 0.5, 0.2)), rod(P, 0.2, 1, center=(0.3, 0, 0)))
    loss(first, 0.02)
    stale = loss(second, 0.02)
    loss.reset()
    assert loss(second, 0.02) == tk.euler_loss(second, genus=0, tau=0.02, euler_weight=0.0) != stale


def test_out_of_reach_is_said_and_can_be_called_backward_on():
    field = ball(P, 0.5).requires_grad_()
    with pytest.warns(UserWarning, match="no movement of the level gives the solid") as caught:
        loss = tk.euler_loss(field, genus=5, tau=0.05, change="add")
    assert str(caught[0].message) == (
        "no movement of the level gives the solid (1, 5, 0) components, tunnels and cavities (change='add'), so the "
        "guard is silent. Is the grid too coarse, or is there nothing yet that could become them?"
    )
    loss.backward()
    assert loss == 0
    assert field.grad.count_nonzero() == 0
    with pytest.warns(UserWarning):
        assert tk.euler_loss(field, genus=5, tau=0.05) == tk.euler_loss(field, -8.0, 0.05, components=None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tk.euler_loss(field, genus=0, tau=0.05)


# shapes


class Network(nn.Module):
    """A torus as a distance with a little network on top; counts the points that are evaluated with a graph."""

    def __init__(self) -> None:
        super().__init__()
        with torch.random.fork_rng():
            torch.manual_seed(0)
            self.inner = nn.Sequential(nn.Linear(3, 16), nn.Softplus(), nn.Linear(16, 1))
        self.with_graph = self.without_graph = 0

    def forward(self, x: Tensor) -> Tensor:
        assert len(x) > 0
        if torch.is_grad_enabled():
            self.with_graph += len(x)
        else:
            self.without_graph += len(x)
        return 0.05 * self.inner(x)[:, 0] - torus(x, 0.5, 0.25)


BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))


@pytest.mark.parametrize("options", [{"target": 2.0, "components": None}, {"genus": 0}, {"genus": 0, "change": "add"}])
def test_of_a_network_only_what_decides_is_evaluated_with_a_graph(options):
    network = Network()
    shape = tk.from_sdf(network, BOX, field_resolution=24)
    network.with_graph = network.without_graph = 0
    loss = tk.euler_loss(shape, tau=0.05, **options)
    assert network.without_graph == 25**3
    assert 0 < network.with_graph < 0.05 * 25**3
    values = shape.field.values()
    assert values.shape == (25, 25, 25)
    dense = tk.euler_loss(values, tau=0.05, connectivity=shape.field.connectivity, **options)
    torch.testing.assert_close(loss, dense)
    parameters = list(network.parameters())
    for ours, expected in zip(*(torch.autograd.grad(one, parameters) for one in (loss, dense)), strict=True):
        torch.testing.assert_close(ours, expected)
        assert ours.abs().max() > 0


def test_a_network_right_already_is_not_called_with_nothing():
    shape = tk.from_occupancy(lambda x: 1000 * (0.6 - x.norm(dim=1)), 0.0, BOX, field_resolution=16)
    assert tk.euler_loss(shape, genus=0, tau=1e-3, change="add") == 0


@pytest.mark.parametrize("connectivity", [6, 26])
def test_voxels_keep_their_level_and_connectivity(connectivity):
    grey = (100 + 50 * LINKS).requires_grad_()
    shape = tk.from_voxels(grey, level=100.0, connectivity=connectivity)
    for options in ({"genus": 2}, {"target": -2.0, "components": None}):
        loss = tk.euler_loss(shape, tau=1.0, **options)
        assert loss == tk.euler_loss(grey, tau=1.0, level=100.0, connectivity=connectivity, **options)
        (gradient,) = torch.autograd.grad(loss, grey)
        assert gradient.isfinite().all()
        assert gradient.abs().max() > 0
    broken = grey.detach().clone()
    broken[0, 0, 0] = math.nan  # background, as the adapter says
    assert tk.euler_loss(tk.from_voxels(broken, level=100.0), genus=2, tau=1.0).isfinite()


def test_points_and_normals_get_finite_gradients():
    cloud = torus_samples(1500, major=1.0, minor=0.5, generator=torch.Generator().manual_seed(1))
    points, normals = cloud.points.clone().requires_grad_(), cloud.normals.clone().requires_grad_()
    for options in ({"genus": 0}, {"target": 2.0, "components": None}):
        loss = tk.euler_loss(tk.from_points(points, normals), tau=0.1, **options, resolution=48)
        assert loss > 1
        for gradient in torch.autograd.grad(loss, (points, normals)):
            assert gradient.isfinite().all()
            assert gradient.abs().max() > 0
    assert tk.euler_loss(tk.from_points(points, normals), genus=1, tau=0.01, components=1) < 0.5


def test_the_grid_around_samples_stays_while_they_fit():
    cloud = torus_samples(1500, major=1.0, minor=0.5, generator=torch.Generator().manual_seed(1))
    loss = tk.EulerLoss(genus=0, resolution=48)
    loss(tk.from_points(cloud.points, cloud.normals), 0.1)
    laid = loss._source._grid
    loss(tk.from_points(cloud.points + 0.01, cloud.normals), 0.1)
    assert loss._source._grid is laid
    loss(tk.from_points(2 * cloud.points, cloud.normals), 0.1)
    assert loss._source._grid is not laid


def test_splat_parameters_get_finite_gradients():
    scene = torus_scene(1500)
    parts = [torch.from_numpy(part).clone().requires_grad_() for part in scene]
    shape = tk.from_splats(tk.GaussianSplats(*parts), n_samples=3000).oriented()
    loss = tk.euler_loss(shape, genus=0, tau=0.1, resolution=48)
    assert loss > 1
    for name, gradient in zip(("means", "scales", "quaternions"), torch.autograd.grad(loss, parts[:3]), strict=True):
        assert gradient.isfinite().all(), name
        assert gradient.abs().max() > 0, name


# refusals

IMPOSSIBLE = (
    "no closed surface of a solid with components={} and cavities={} has χ = {}: χ = 2 (components + cavities − genus). "
    "Change components, or pass components=None to ask for χ alone."
)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "give either target or genus: got target=None and genus=None."),
        ({"target": 2.0, "genus": 0}, "give either target or genus: got target=2.0 and genus=0."),
        ({"target": 3.0}, IMPOSSIBLE.format(1, 0, 3)),
        ({"target": 4.0}, IMPOSSIBLE.format(1, 0, 4)),
        ({"genus": -1}, IMPOSSIBLE.format(1, 0, 4)),
        ({"genus": 0.5}, IMPOSSIBLE.format(1, 0, 1)),
        ({"target": 0.0, "components": 0}, IMPOSSIBLE.format(0, 0, 0)),
        ({"target": 1.0, "components": 1.5}, IMPOSSIBLE.format(1.5, 0, 1)),
        ({"target": 2.0, "cavities": -1}, IMPOSSIBLE.format(1, -1, 2)),
        ({"genus": (1, 0.5)}, IMPOSSIBLE.format(1, 0, 1)),
        ({"genus": (1, 0), "cavities": 1}, "one genus per component goes with cavities=0."),
        ({"target": ()}, "target must be a finite number, or a list of one for each component, not ()."),
        ({"target": "2"}, "target must be a finite number, or a list of one for each component, not '2'."),
        ({"genus": math.nan}, "genus must be a finite number, or a list of one for each component, not nan."),
        ({"genus": 0, "components": None}, "genus needs components: without them it does not say what χ is."),
        (
            {"target": 2.0, "components": None, "cavities": 1},
            "cavities need components: χ alone does not tell them from components.",
        ),
        (
            {"target": 2.0, "components": None, "change": "add"},
            "change='add' needs components: χ alone knows no such distinction.",
        ),
        ({"genus": 0, "change": "both"}, "change must be one of ('any', 'add', 'remove'), not 'both'."),
        ({"genus": 0, "reduction": "max"}, "reduction must be one of ('mean', 'sum', 'none'), not 'max'."),
        ({"genus": 0, "connectivity": 18}, "connectivity must be 6 or 26, not 18."),
        ({"genus": 0, "level": math.nan}, "level must be a finite number, not nan."),
        ({"genus": 0, "refresh": 0}, "refresh must be at least 1, not 0."),
        ({"genus": 0, "resolution": 8}, "resolution must be at least 16 grid points, not 8."),
        ({"genus": 0, "guard_weight": -1}, "weights must be finite and not negative, got 1.0 and -1."),
    ],
)
def test_wrong_options_are_named(options, message):
    with pytest.raises(InputError) as caught:
        tk.EulerLoss(**options)
    assert str(caught.value) == message


@pytest.mark.parametrize("tau", [0, -1.0, math.nan, math.inf, 1e-320, torch.tensor([0.1, 0.2])])
def test_wrong_tau_is_named(tau):
    for options in ({}, {"components": None}):
        with pytest.raises(InputError) as caught:
            tk.euler_loss(LINKS, 2.0, tau, **options)
        assert str(caught.value) == f"tau must be a positive number, not {tau!r}."


def test_wrong_sources_are_named():
    said = "the loss got a tensor of shape {} and type {}; expected a floating-point field (..., X, Y, Z), positive "
    for field in (
        torch.ones(4, 4),
        torch.ones(4, 4, 4, dtype=torch.int32),
        torch.ones(0, 4, 4),
        torch.ones(0, 2, 2, 2),
    ):
        for options in ({}, {"components": None}):
            with pytest.raises(InputError) as caught:
                tk.euler_loss(field, 2.0, 0.1, **options)
            assert str(caught.value) == said.format(tuple(field.shape), field.dtype) + "inside and not empty."
    with pytest.raises(InputError) as caught:
        tk.euler_loss([[[1.0]]], 2.0, 0.1)
    assert str(caught.value) == "the loss got list; expected a field (..., X, Y, Z), positive inside, or a Shape."
    with pytest.raises(InputError, match="neither a field nor one cloud with oriented normals: pass normals to from_"):
        tk.euler_loss(tk.from_points(torus_samples(300).points), 2.0, 0.1)
