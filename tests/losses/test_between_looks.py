"""Between looks at the grid the losses evaluate only what decides, and never visit the host."""

from __future__ import annotations

import copy
import io
from collections.abc import Callable

import pytest
import torch
from analytic_fields import grid, torus
from torch import Tensor, nn

import topokit as tk
from topokit.core.cloud.normals.dipoles import DipoleSolver
from topokit.core.grid.grid import make_grid
from topokit.core.grid.winding_field import regularize, winding_field
from topokit.errors import InputError
from topokit.losses import SearchOptions
from topokit.losses.field_loss import FieldLoss
from topokit.losses.memory import KnownValues
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


LOSSES: dict[str, Callable[[], FieldLoss]] = {
    "topology": lambda: tk.TopologyLoss(genus=0, search=SearchOptions(evaluate_every=4)),
    "euler": lambda: tk.EulerLoss(2.0, search=SearchOptions(evaluate_every=4)),
}
SOURCES: dict[str, Callable[[Tensor], Tensor | tk.Shape]] = {
    "field": lambda weight: FIELD * weight,
    "batch": lambda weight: torch.stack((FIELD, FIELD)) * weight,
    "volume": lambda weight: tk.from_voxels(FIELD * weight, level=0.0),
    "network": lambda weight: tk.from_sdf(
        lambda x: (torch.hypot(x[:, :2].norm(dim=1) - 0.5, x[:, 2]) - 0.25) * weight, bounds=BOX, field_resolution=16
    ),
}


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("name", LOSSES)
def test_no_visit_between_tracks(name: str, source: str) -> None:
    loss, weight = LOSSES[name](), torch.ones((), requires_grad=True)
    with as_on_accelerator():
        first = loss(SOURCES[source](weight), 0.05)
        made = SOURCES[source](weight)
        with count_host_visits() as visits:
            value = loss(made, 0.05)
            value.backward()
    assert len(visits) == 0, str(visits)
    torch.testing.assert_close(value, first)
    assert weight.grad is not None
    assert weight.grad != 0


@pytest.mark.parametrize("genus", [0, 1])
@pytest.mark.parametrize("source", ["field", "network"])
def test_nan_between_tracks_gives_nan_and_the_next_look_refuses_it(source: str, genus: int) -> None:
    loss = tk.TopologyLoss(genus=genus, search=SearchOptions(evaluate_every=2))
    sound, broken = torch.ones(()), torch.tensor(torch.nan)
    with as_on_accelerator():
        expected = loss(SOURCES[source](sound), 1e-3)
        assert (expected > 0) == (genus == 0)
        made = SOURCES[source](broken)
        with count_host_visits() as visits:
            value = loss(made, 1e-3)
        assert value.isnan()
        for _ in range(2):
            with pytest.raises(InputError, match="is NaN at"):
                loss(SOURCES[source](broken), 1e-3)
        assert loss(SOURCES[source](sound), 1e-3) == expected
    assert len(visits) == 0, str(visits)


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
    ring, known = Ring(), KnownValues(whole_every=5)
    counts = []
    for step in range(6):
        ring.n_points = 0
        with torch.no_grad():
            ring.minor += 0.002
        field = ring.shape().field
        assert field is not None
        ring.n_points = 0
        values = known.update(field, 0.01)
        counts.append(ring.n_points)
        exact = field.detached()
        near = exact.abs() < 0.05
        assert near.sum() > 1000
        assert torch.equal(values[near], exact[near])
        assert torch.equal(values > 0, exact > 0)
        assert (step % 5 == 0) == torch.equal(values, exact)
    assert counts[0] == counts[5] == 33**3
    assert max(counts[1:5]) < 0.3 * 33**3


def test_the_topology_loss_evaluates_near_the_level_and_where_voxels_decide_whatever_tau_is() -> None:
    """A ball that has to go is decided everywhere in it, also five cells deep; it shrinks meanwhile."""
    ring = Ring()
    ring.bump.data.fill_(0.7)
    near, whole = (tk.TopologyLoss(genus=1, change="remove") for _ in range(2))
    for step in range(5):
        for track in whole.tracker._tracks:
            track.known._known = None  # so that all is evaluated
        expected = whole(ring.shape(), 0.5)
        shape = ring.shape()
        ring.n_points = 0
        value = near(shape, 0.5)
        assert expected > 0.2
        torch.testing.assert_close(value, expected)
        assert (ring.n_points < 0.35 * 33**3) == (step > 0)
        ring.bump.data.sub_(0.06)


def test_a_part_that_appears_far_from_the_level_is_seen_at_the_next_whole_evaluation() -> None:
    ring = Ring()
    loss = tk.EulerLoss(0.0, search=SearchOptions(search_every=3))
    assert loss(ring.shape(), 0.01) < 0.1
    ring.bump.data.fill_(0.7)  # a ball of radius 0.3 in a corner
    assert [bool(loss(ring.shape(), 0.01) > 3) for _ in range(3)] == [False, False, True]


def test_a_search_changes_neither_value_nor_gradient_of_the_euler_loss() -> None:
    ring = Ring()
    plain, searching = tk.EulerLoss(2.0), tk.EulerLoss(2.0, search=SearchOptions(evaluate_every=2))
    for _ in range(5):
        found = [torch.autograd.grad(loss(ring.shape(), 0.03), ring.minor)[0] for loss in (plain, searching)]
        torch.testing.assert_close(*found)
    default = [loss(ring.shape()) for loss in (plain, searching)]
    torch.testing.assert_close(*default)


@pytest.mark.parametrize("name", LOSSES)
def test_a_resumed_training_goes_on_with_what_was_known(name: str) -> None:
    ring, loss = Ring(), LOSSES[name]()
    loss(ring.shape(), 0.05)
    file = io.BytesIO()
    torch.save(loss.state_dict(), file)
    file.seek(0)
    resumed = LOSSES[name]()
    resumed.load_state_dict(torch.load(file, weights_only=True))
    for other in (copy.deepcopy(loss), resumed):
        ring.n_points = 0
        assert torch.equal(other(ring.shape(), 0.05), loss(ring.shape(), 0.05))
        assert ring.n_points < 33**3


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
