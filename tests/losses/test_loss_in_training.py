"""The losses at work: shapes of every kind, and short optimizations judged by marching cubes."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import pytest
import torch
from analytic_fields import ball, grid, meshed_topology, rod, torus, union, without
from splat_writers import torus_scene
from torch import Tensor, nn

import topokit as tk
from topokit.core.blocks.whole import count_solid
from topokit.core.grid.grid import Grid
from topokit.losses.source import FieldSource
from topokit.testing import torus_samples

DOUBLE = torch.float64


def optimize(start: Tensor, loss: tk.TopologyLoss, tau: float, steps: int = 60, rate: float = 0.01) -> Tensor:
    """The field after gradient descent, held near its start by a data term."""
    field = start.clone().requires_grad_()
    optimizer = torch.optim.Adam([field], rate)
    for _ in range(steps):
        optimizer.zero_grad()
        (loss(field, tau, keys="field") + (field - start).square().mean()).backward()
        optimizer.step()
    return field.detach()


# plain grids


def test_a_torus_becomes_a_ball() -> None:
    start = torus(grid(32), 0.5, 0.25).float()
    assert meshed_topology(start) == (1, 0)
    field = optimize(start, tk.TopologyLoss(genus=0), tau=0.03)
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
def test_each_kind_of_change_is_reached(start: Tensor, options: dict[str, Any], surfaces: int, euler: int) -> None:
    assert meshed_topology(start) != (surfaces, euler)
    assert meshed_topology(optimize(start, tk.TopologyLoss(**options), tau=0.04)) == (surfaces, euler)


def tunnels_by_size(field: Tensor) -> list[int]:
    x, y, z = field.shape
    return count_solid(field, lambda values: values > 0, 26, Grid((x, y, z))).solid_betti[:, 1].tolist()


def test_each_component_gets_its_own_topology() -> None:
    """A dimpled disc and a smaller torus: each may have the hole; the genus of the larger one comes first."""
    disc = without(rod(P, 0.45, 0.3, center=(-0.5, 0, 0)), *(ball(P, 0.4, (-0.5, 0, z)) for z in (0.5, -0.5)))
    start = union(disc, torus(P, 0.28, 0.12, (0.6, 0, 0)))

    assert tunnels_by_size(start) == [0, 1]
    for genus in ((1, 0), (0, 0), (1, 1)):
        field = optimize(start, tk.TopologyLoss(genus=genus), tau=0.04)
        assert tunnels_by_size(field) == list(genus)
        assert meshed_topology(field) == (2, 4 - 2 * sum(genus))


def test_the_number_of_components_is_corrected_first_and_then_each_of_them() -> None:
    three = union(torus(P, 0.28, 0.12, (-0.5, 0, 0)), torus(P, 0.25, 0.12, (0.5, 0, 0)), ball(P, 0.1, (0, 0.7, 0.7)))
    field = optimize(three, tk.TopologyLoss(genus=(0, 1)), tau=0.04, steps=100)
    assert tunnels_by_size(field) == [0, 1]


def test_components_that_merge_are_separated_again() -> None:
    apart = union(ball(P, 0.35, (-0.5, 0, 0)), ball(P, 0.35, (0.5, 0, 0)))
    joined = union(apart, rod(P, 0.15, 0.6, axis=0))
    loss = tk.TopologyLoss(genus=(0, 0))
    assert loss(apart, 0.02) == 0
    assert loss(joined, 0.02) > 1e-4
    field = apart.clone().requires_grad_()
    optimizer = torch.optim.Adam([field], 5e-3)
    for _ in range(100):
        optimizer.zero_grad()
        ((field - joined).square().mean() + loss(field, keys="field")).backward()
        optimizer.step()
    assert meshed_topology(field) == (2, 4)


def test_out_of_reach_gives_a_warning_and_a_zero_with_a_graph() -> None:
    field = ball(P, 0.5).requires_grad_()
    with pytest.warns(UserWarning, match="no solid with the Betti numbers") as caught:
        loss = tk.TopologyLoss(genus=5, change="add")(field, tau=0.05)
    assert str(caught[0].message) == (
        "no solid with the Betti numbers (1, 5, 0) is in reach (change='add'): the loss is 0 there. Is the grid too "
        "coarse, is there nothing yet that could become it, or does it need another change?"
    )
    loss.backward()
    assert loss == 0
    assert field.grad is not None
    assert field.grad.count_nonzero() == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tk.topology_loss(field, genus=0, tau=0.05)


@pytest.mark.parametrize(
    "call", [tk.TopologyLoss(genus=1), lambda fields, tau: tk.topology_loss(fields, 1, tau)], ids=["module", "function"]
)
def test_the_warning_names_the_batch_items_and_the_line_of_the_call(call: Callable[..., Tensor]) -> None:
    reachable, unreachable = torus(P, 0.5, 0.25), ball(P, 0.5)
    for fields, named in (
        (torch.stack([unreachable, reachable]), " for batch item 0 "),
        (torch.stack([unreachable, reachable, unreachable]), " for batch items 0, 2 "),
        (torch.stack([reachable] * 3 + [unreachable]).reshape(2, 2, *P.shape[:3]), " for batch item (1, 1) "),
    ):
        with pytest.warns(UserWarning, match="no solid with the Betti numbers") as caught:
            call(fields, tau=0.05)
        assert caught[0].filename == __file__
        assert f"is in reach{named}(change='any')" in str(caught[0].message)


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


def euler(source: Tensor | tk.Shape, tau: float, **options: Any) -> Tensor:
    return tk.euler_loss(source, 2.0, tau, **options)


def topology(source: Tensor | tk.Shape, tau: float, **options: Any) -> Tensor:
    return tk.topology_loss(source, 0, tau, **options)


def adding(source: Tensor | tk.Shape, tau: float, **options: Any) -> Tensor:
    return tk.topology_loss(source, 0, tau, change="add", **options)


@pytest.mark.parametrize("loss", [euler, topology, adding])
def test_of_a_network_only_the_voxels_that_matter_are_evaluated_with_a_graph(loss: Callable[..., Tensor]) -> None:
    network = Network()
    shape = tk.from_sdf(network, bounds=BOX, field_resolution=24)
    network.with_graph = network.without_graph = 0
    value = loss(shape, 0.05)
    assert network.without_graph == 25**3
    assert 0 < network.with_graph < 0.05 * 25**3
    assert shape.field is not None
    field = shape.field.values()
    assert field.shape == (25, 25, 25)
    dense = loss(field, 0.05)
    torch.testing.assert_close(value, dense)
    parameters = list(network.parameters())
    for ours, expected in zip(*(torch.autograd.grad(one, parameters) for one in (value, dense)), strict=True):
        torch.testing.assert_close(ours, expected)
        assert ours.abs().max() > 0


def test_a_network_with_the_right_topology_is_not_called_with_an_empty_tensor() -> None:
    def occupancy(x: Tensor) -> Tensor:
        assert len(x) > 0
        return 1000 * (0.6 - x.norm(dim=1))

    shape = tk.from_occupancy(occupancy, level=0.0, bounds=BOX, field_resolution=16)
    assert tk.topology_loss(shape, genus=0, tau=1e-3, change="add") == 0


@pytest.mark.parametrize("connectivity", [6, 26])
def test_voxels_keep_their_level_and_connectivity(connectivity: int) -> None:
    gray = (100 + 50 * LINKS + torch.where(P[..., 0] > 0.9, 100 * (P.sum(-1) * 19).sin(), 0)).requires_grad_()
    shape = tk.from_voxels(gray, level=100.0, connectivity=connectivity)
    pairs = [
        (tk.topology_loss(shape, 2, 1.0), tk.topology_loss(gray, 2, 1.0, level=100.0)),
        (
            tk.euler_loss(shape, -2.0, 1.0),
            tk.euler_loss(gray, -2.0, 1.0, level=100.0, connectivity=connectivity),
        ),
    ]
    for loss, plain in pairs:
        torch.testing.assert_close(loss, plain)
        (gradient,) = torch.autograd.grad(loss, gray)
        assert gradient.isfinite().all()
        assert gradient.abs().max() > 0
    other = tk.euler_loss(gray, -2.0, 1.0, level=100.0, connectivity=32 - connectivity)
    assert not torch.isclose(pairs[1][0], other)  # so the connectivity does matter here


def test_nan_in_a_volume_is_background() -> None:
    broken = 100 + 50 * LINKS
    expected = tk.topology_loss(tk.from_voxels(broken, level=100.0), genus=2, tau=1.0)
    broken[0, 0, 0] = math.nan
    assert tk.topology_loss(tk.from_voxels(broken, level=100.0), genus=2, tau=1.0) == expected


def test_points_and_normals_get_finite_gradients() -> None:
    cloud = torus_samples(1500, major=1.0, minor=0.5, generator=torch.Generator().manual_seed(1))
    points, normals = cloud.points.clone().requires_grad_(), cloud.normals.clone().requires_grad_()
    for loss in (topology, euler):
        value = loss(tk.from_points(points, normals), tau=0.1, resolution=48)
        assert value > 0.1
        for gradient in torch.autograd.grad(value, (points, normals)):
            assert gradient.isfinite().all()
            assert gradient.abs().max() > 0
    assert tk.topology_loss(tk.from_points(points, normals), genus=1, tau=0.01) < 1e-2


def test_the_grid_around_samples_is_kept_while_they_fit() -> None:
    cloud = torus_samples(1500, major=1.0, minor=0.5, generator=torch.Generator().manual_seed(1))
    grids: list[Grid | None] = [None]
    for shift, scale in ((0.0, 1.0), (0.01, 1.0), (0.0, 2.0)):
        moved = tk.from_points(scale * cloud.points + shift, cloud.normals)
        [(field, n_terms)] = FieldSource(0.0, 26, 48)(moved, [grids[-1]])
        assert n_terms == pytest.approx(1500 / (4 * math.pi) ** 2)
        grids.append(field.grid)
    _, first, shifted, scaled = grids
    assert first is not None
    assert scaled is not None
    assert shifted == first
    assert scaled.cell > 1.5 * first.cell


def test_splat_parameters_get_finite_gradients() -> None:
    scene = torus_scene(1500)
    parts = [torch.from_numpy(part).clone().requires_grad_() for part in scene]
    shape = tk.from_splats(tk.GaussianSplats(*parts), n_samples=3000).oriented()
    loss = tk.topology_loss(shape, genus=0, tau=0.1, resolution=48)
    assert loss > 0.1
    for name, gradient in zip(("means", "scales", "quaternions"), torch.autograd.grad(loss, parts[:3]), strict=True):
        assert gradient.isfinite().all(), name
        assert gradient.abs().max() > 0, name
