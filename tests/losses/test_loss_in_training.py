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
from topokit.core.grid.components import betti_by_component
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
        return betti_by_component(field, 0.0, 6)[:, 1].tolist()

    assert tunnels_by_size(start) == [0, 1]
    for genus in ((0, 1), (1, 0), (0, 0), (1, 1)):
        field = optimised(start, tk.EulerLoss(genus=genus), tau=0.04)
        assert tunnels_by_size(field) == list(genus)
        assert meshed_topology(field) == (2, 4 - 2 * sum(genus))


def test_parts_are_first_counted_and_then_mended():
    three = union(torus(P, 0.28, 0.12, (-0.5, 0, 0)), torus(P, 0.25, 0.12, (0.5, 0, 0)), ball(P, 0.1, (0, 0.7, 0.7)))
    field = optimised(three, tk.EulerLoss(genus=(0, 1)), tau=0.04, steps=100)
    assert betti_by_component(field, 0.0, 6)[:, 1].tolist() == [0, 1]


def test_parts_that_meet_are_told_apart_again():
    apart = union(ball(P, 0.35, (-0.5, 0, 0)), ball(P, 0.35, (0.5, 0, 0)))
    joined = union(apart, rod(P, 0.15, 0.6, axis=0))
    loss = tk.EulerLoss(genus=(0, 0))
    assert loss(apart, 0.02) == 0
    assert loss(joined, 0.02) > 0.5
    field = apart.clone().requires_grad_()
    optimizer = torch.optim.Adam([field], 5e-3)
    for _ in range(100):
        optimizer.zero_grad()
        ((field - joined).square().mean() + 1e-2 * loss(field)).backward()
        optimizer.step()
    assert meshed_topology(field) == (2, 4)


def test_a_module_that_is_reset_starts_anew():
    loss = tk.EulerLoss(genus=0)
    first, second = torus(P, 0.5, 0.2), without(block(P, (0.8, 0.5, 0.2)), rod(P, 0.2, 1, center=(0.3, 0, 0)))
    loss(first, 0.02)
    stale = loss(second, 0.02)
    loss.reset()
    assert loss(second, 0.02) == tk.euler_loss(second, genus=0, tau=0.02) != stale


def test_out_of_reach_is_said_and_can_be_called_backward_on():
    field = ball(P, 0.5).requires_grad_()
    silent = tk.EulerLoss(genus=5, change="add")
    with pytest.warns(UserWarning, match="no solid with the Betti numbers") as caught:
        loss = silent(field, tau=0.05)
    assert caught[0].filename == __file__
    assert str(caught[0].message) == (
        "no solid with the Betti numbers (1, 5, 0) is in reach (change='add'), so the guard is silent. Is the grid too "
        "coarse, is there nothing yet that could become them, or do they need another change?"
    )
    loss.backward()
    assert loss == 0
    assert field.grad.count_nonzero() == 0
    alone = tk.euler_loss(field, -8.0, 0.05, components=None)
    with pytest.warns(UserWarning, match=r"change='any'"):
        assert tk.euler_loss(field, genus=5, tau=0.05, euler_weight=2.0) == 2 * alone
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
    shape = tk.from_sdf(network, bounds=BOX, field_resolution=24)
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


def test_between_looks_the_voxels_last_found_are_pushed():
    evaluations = []

    def sdf(p):
        evaluations.append(len(p))
        return torch.hypot(p[:, :2].norm(dim=-1) - 0.5, p[:, 2]) - 0.3

    shape = tk.from_sdf(sdf, bounds=((-1,) * 3, (1,) * 3), field_resolution=16)
    loss = tk.EulerLoss(genus=0, change="add", look_every=3)
    answers = []
    for _ in range(4):
        evaluations.clear()
        answers.append((float(loss(shape, tau=0.05)), sum(evaluations) >= 17**3))
    assert [is_look for _, is_look in answers] == [True, False, False, True]
    assert len({value for value, _ in answers}) == 1


def test_a_network_right_already_is_not_called_with_nothing():
    shape = tk.from_occupancy(lambda x: 1000 * (0.6 - x.norm(dim=1)), level=0.0, bounds=BOX, field_resolution=16)
    assert tk.euler_loss(shape, genus=0, tau=1e-3, change="add") == 0


@pytest.mark.parametrize("connectivity", [6, 26])
def test_voxels_keep_their_level_and_connectivity(connectivity):
    grey = (100 + 50 * LINKS).requires_grad_()
    shape = tk.from_voxels(grey, level=100.0, connectivity=connectivity)
    for options in ({"genus": 2, "euler_weight": 1.0}, {"target": -2.0, "components": None}):
        loss = tk.euler_loss(shape, tau=1.0, **options)
        plain = tk.euler_loss(grey, tau=1.0, level=100.0, connectivity=connectivity, **options)
        torch.testing.assert_close(loss, plain)
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
