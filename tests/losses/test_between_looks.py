"""What losses evaluate of functions that they know, and what never visits the host."""

from __future__ import annotations

import pytest
import torch
from analytic_fields import grid, torus
from torch import Tensor, nn

import topokit as tk
from topokit.core.cloud.normals.dipoles import DipoleSolver
from topokit.core.grid.grid import make_grid
from topokit.core.grid.winding_field import regularize, winding_field
from topokit.losses.memory import values_of
from topokit.testing import as_on_accelerator, count_host_visits, sphere_samples, torus_samples

BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
FIELD = torus(grid(20), 0.5, 0.25).float()


class Ring(nn.Module):
    """A torus by its distance, and perhaps a ball in a corner; counts the points at which it is evaluated."""

    def __init__(self) -> None:
        super().__init__()
        self.minor = nn.Parameter(torch.tensor(0.25))
        self.bump = nn.Parameter(torch.tensor(-10.0))  # no bump
        self.n_points = 0

    def forward(self, x: Tensor) -> Tensor:
        self.n_points += len(x)
        ring = torch.hypot(x[:, :2].norm(dim=1) - 0.5, x[:, 2]) - self.minor
        return torch.minimum(ring, 0.4 + (x - 0.9).norm(dim=1) - self.bump)

    def shape(self) -> tk.Shape:
        return tk.from_sdf(self, bounds=BOX, field_resolution=32)


def test_the_smoothed_characteristic_of_values_takes_no_look() -> None:
    field = FIELD.clone().requires_grad_()
    on_cpu = tk.from_voxels(field, level=0.0).smoothed_euler(0.05)
    with as_on_accelerator():
        shape = tk.from_voxels(field, level=0.0)
        with count_host_visits() as visits:
            value = shape.smoothed_euler(0.05)
            value.backward()
    assert len(visits) == 0, str(visits)
    torch.testing.assert_close(value, on_cpu)


def test_a_winding_field_on_a_given_grid_takes_no_look() -> None:
    known = sphere_samples(500)
    around = make_grid(known.points, 0.1, 1.0)
    points, areas = known.points.clone().requires_grad_(), torch.full((500,), 0.025, dtype=torch.float64)
    with as_on_accelerator(), count_host_visits() as visits:
        field = winding_field(points, known.normals, areas, around)
        moved, _ = regularize(points, known.normals, areas, around)
        (field.sample(points).sum() + moved.sum()).backward()
    assert len(visits) == 0, str(visits)


def test_the_conjugate_gradients_of_orientation_take_no_look() -> None:
    known = sphere_samples(400)
    solver = DipoleSolver(known.points, torch.ones(400), 0.1)
    with count_host_visits() as visits:
        dipoles = solver.alternate(solver.conjugate_gradients(1.0, 4), 2.0, 1.0, 3)
    assert len(visits) == 0, str(visits)
    assert ((dipoles * known.normals).sum(1) > 0).all()


def test_only_the_band_around_the_level_is_evaluated_between_whole_evaluations() -> None:
    ring, memory = Ring(), {}
    counts = []
    for step in range(6):
        with torch.no_grad():
            ring.minor += 0.002
        field = ring.shape().field
        assert field is not None
        ring.n_points = 0
        values = values_of(field, memory, 5)
        counts.append(ring.n_points)
        exact = field.detached()
        near = exact.abs() < 0.05
        assert near.sum() > 1000
        assert torch.equal(values[near], exact[near])
        assert torch.equal(values > 0, exact > 0)
        assert (step % 5 == 0) == torch.equal(values, exact)
    assert counts[0] == counts[5] == 33**3
    assert max(counts[1:5]) < 0.3 * 33**3


def test_with_a_key_a_function_is_evaluated_near_the_level_and_where_voxels_decide() -> None:
    """A ball that has to go is decided everywhere in it, also five cells deep; it shrinks meanwhile."""
    ring = Ring()
    ring.bump.data.fill_(0.7)
    near = tk.TopologyLoss(genus=1, change="remove")
    for step in range(4):
        expected = tk.topology_loss(ring.shape(), 1, change="remove")
        shape = ring.shape()
        ring.n_points = 0
        value = near(shape, keys="ring")
        assert expected > 1e-4
        torch.testing.assert_close(value, expected)
        assert (ring.n_points < 0.35 * 33**3) == (step > 0)
        ring.bump.data.sub_(0.06)


@pytest.mark.parametrize("ragged", [True, False])
def test_batches_of_clouds(ragged: bool) -> None:
    clouds = [torus_samples(500, major=1.0, minor=0.5), sphere_samples(400)]
    lengths = [500, 400] if ragged else [400, 400]
    rows = max(lengths)
    points, normals = (torch.zeros(2, rows, 3, dtype=torch.float64) for _ in range(2))
    for row, (known, length) in enumerate(zip(clouds, lengths, strict=True)):
        points[row, :length], normals[row, :length] = known.points[:length], known.normals[:length]
    batch = tk.from_points(points.requires_grad_(), normals, lengths=lengths)
    loss = tk.EulerLoss(2.0, reduction="none", resolution=32)
    values = loss(batch, 0.05)
    alone = [tk.from_points(points[row, :length], normals[row, :length]) for row, length in enumerate(lengths)]
    torch.testing.assert_close(values, torch.stack([tk.euler_loss(one, 2.0, 0.05, resolution=32) for one in alone]))
    assert tk.TopologyLoss(genus=0, resolution=32, reduction="none")(batch, 0.05).shape == (2,)
    values.sum().backward()
    assert points.grad is not None
    assert (points.grad[1, lengths[1] :] == 0).all()
