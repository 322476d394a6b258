"""The topology monitor: when it counts, what it records, and when the goal is reached."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import pytest
import torch
from analytic_fields import ball, grid, torus, union, without
from torch import Tensor, nn

import topokit as tk
from topokit.errors import InputError
from topokit.losses import TopologyRecord
from topokit.losses.field_loss import CountedSolid, FieldLoss
from topokit.testing import torus_samples

P = grid(16)
BALL = ball(P, 0.6)
TORUS = torus(P, 0.5, 0.25)
SHELL = without(BALL, ball(P, 0.3))


def test_it_counts_when_it_is_time_and_logs_a_line(caplog: pytest.LogCaptureFixture) -> None:
    calls = []

    def source_of(field: Tensor) -> Callable[[], Tensor]:
        return lambda: calls.append(1) or field

    monitor = tk.TopologyMonitor(every=10)
    with caplog.at_level(logging.INFO, logger="topokit"):
        for step, field in enumerate([SHELL] * 15 + [TORUS] * 15):
            assert not monitor(step, source_of(field))
    assert len(calls) == 3
    assert monitor.history == [
        TopologyRecord(0, 4, 1, 0, 1),
        TopologyRecord(10, 4, 1, 0, 1),
        TopologyRecord(20, 0, 1, 1, 0),
    ]
    assert monitor.columns() == {
        "step": [0, 10, 20],
        "euler": [4, 4, 0],
        "components": [1, 1, 1],
        "tunnels": [0, 0, 1],
        "cavities": [1, 1, 0],
    }
    assert [record.getMessage() for record in caplog.records] == [
        "step 0: χ 4, components 1, tunnels 0, cavities 1",
        "step 10: χ 4, components 1, tunnels 0, cavities 1",
        "step 20: χ 0, components 1, tunnels 1, cavities 0",
    ]


def test_patience_counts_successes_in_a_row() -> None:
    monitor = tk.TopologyMonitor(tk.TopologyLoss(genus=0), every=1, patience=2)
    fields = [BALL, TORUS, BALL, BALL, BALL, SHELL]
    assert [monitor(step, field) for step, field in enumerate(fields)] == [False, False, False, True, True, False]


@pytest.mark.parametrize(
    ("loss", "right", "wrong"),
    [
        (tk.TopologyLoss(genus=0), BALL, TORUS),
        (tk.TopologyLoss(genus=0, cavities=1), SHELL, BALL),
        (tk.TopologyLoss(genus=0), BALL, union(TORUS, ball(P, 0.2, (0.8, 0.8, 0.8)))),
        (tk.EulerLoss(0.0), TORUS, BALL),
    ],
)
def test_the_goal_is_that_of_the_loss(loss: tk.TopologyLoss | tk.EulerLoss, right: Tensor, wrong: Tensor) -> None:
    for field, is_met in ((right, True), (wrong, False)):
        assert tk.TopologyMonitor(loss, every=1, patience=1)(0, field) == is_met


def test_the_genus_of_each_component_is_counted() -> None:
    field = union(ball(P, 0.4, (-0.5, 0, 0)), torus(P, 0.25, 0.14, (0.55, 0, 0)))
    for genus, is_met in (((0, 1), True), ((1, 0), False)):
        assert tk.TopologyMonitor(tk.TopologyLoss(genus), every=1, patience=1)(0, field) == is_met


class CavityLoss(FieldLoss):
    """A loss of a stranger, as CONTRIBUTING.md invites: no cavities."""

    def forward(self, source: Tensor | tk.Shape) -> Tensor:
        return self.reduce(torch.stack([field.smoothed_euler(0.1) for field in self.source(source)]))

    def is_met(self, solid: CountedSolid) -> bool:
        return solid.betti[2] == 0


def test_any_loss_on_fields_is_watched() -> None:
    monitor = tk.TopologyMonitor(CavityLoss(5.0, 6, 48, "mean"), every=1, patience=1)
    fields = [SHELL + 5, TORUS + 5, union(TORUS, SHELL) + 5, BALL + 5]
    assert [monitor(step, field) for step, field in enumerate(fields)] == [False, True, False, True]
    assert monitor.columns()["cavities"] == [1, 0, 1, 0]


def test_a_loss_that_cannot_say_when_its_goal_is_met_is_not_made() -> None:
    class Unfinished(FieldLoss):
        pass

    with pytest.raises(TypeError, match="is_met"):
        Unfinished(0.0, 26, 64, "mean")


def counted_euler(source: Tensor | tk.Shape, *arguments: Any, **options: Any) -> int:
    monitor = tk.TopologyMonitor(*arguments, every=1, **options)
    monitor(0, source)
    return monitor.history[0].euler


def test_it_takes_what_the_losses_take() -> None:
    assert counted_euler(TORUS.half()) == counted_euler(TORUS + 5, level=5.0) == counted_euler(TORUS[None]) == 0
    assert counted_euler(tk.from_voxels(TORUS, level=0.0)) == 0
    cloud = torus_samples(1500, major=1.0, minor=0.5, generator=torch.Generator().manual_seed(1))
    assert counted_euler(tk.from_points(cloud.points, cloud.normals), resolution=48) == 0


def test_settings_are_those_of_the_loss_unless_given() -> None:
    loss = tk.TopologyLoss(genus=1, level=5.0, resolution=48)
    assert counted_euler(TORUS + 5, loss) == 0
    assert counted_euler(TORUS + 5, loss, level=9.0) == 0 == tk.TopologyMonitor(loss).history.__len__()
    assert tk.TopologyMonitor(loss)._source.resolution == 48
    diagonal = torch.eye(3)[..., None] - 0.5
    assert counted_euler(diagonal) == 2
    assert counted_euler(diagonal, connectivity=6) == 6
    assert counted_euler(diagonal, tk.EulerLoss(2.0, connectivity=6)) == 6


def test_a_proof_decides_whether_training_may_stop() -> None:
    """A floating part that is too small for the grid of the monitor is no obstacle for its count, but for the proof."""

    def sphere(points: Tensor) -> Tensor:
        return points.norm(dim=1) - 0.5

    def with_speck(points: Tensor) -> Tensor:
        speck = (points - torch.tensor([0.71, 0.71, 0.71], dtype=points.dtype)).norm(dim=1) - 0.02
        return torch.minimum(sphere(points), speck)

    monitor = tk.TopologyMonitor(tk.TopologyLoss(genus=0), every=1, patience=2, certify=30.0)
    shapes = [tk.from_sdf(one, bounds=(-1, 1), field_resolution=16) for one in (with_speck, sphere)]
    assert [monitor(step, shapes[step > 3]) for step in range(6)] == [False] * 5 + [True]
    assert {record.components for record in monitor.history} == {1}
    assert (monitor.certificate.verdict, monitor.certificate.euler) == ("certain", 2)
    with pytest.raises(InputError, match="from_sdf"):
        tk.TopologyMonitor(tk.TopologyLoss(genus=0), every=1, patience=1, certify=1.0)(0, BALL)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"certify": 0}, "certify must be a positive number of seconds, not 0."),
        ({"every": 0}, "every must be an integer of at least 1, not 0."),
        ({"patience": 1.5}, "patience must be an integer of at least 1, not 1.5."),
        ({"connectivity": 18}, "connectivity must be one of (6, 26), not 18."),
        ({"loss": 2.0}, "loss must be a TopologyLoss, an EulerLoss, another FieldLoss or None, not 2.0."),
    ],
)
def test_wrong_options_are_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        tk.TopologyMonitor(**options)
    assert str(caught.value) == message


def network(points: Tensor) -> Tensor:
    return points.norm(dim=1) - 0.5


@pytest.mark.parametrize("source", [nn.Linear(3, 1), torch.compile(nn.Linear(3, 1), backend="eager"), network])
def test_networks_are_refused_with_advice(source: Any) -> None:
    with pytest.raises(InputError) as caught:
        tk.TopologyMonitor()(0, source)
    assert str(caught.value) == (
        "expected a field, a Shape, or a function without arguments that returns one; got "
        f"{type(source).__name__}, which needs arguments. Wrap a network as a shape: tk.from_sdf(net)."
    )


def test_wrong_steps_and_sources_are_named() -> None:
    monitor: Any = tk.TopologyMonitor()
    with pytest.raises(InputError) as caught:
        monitor(BALL, 0)
    assert str(caught.value) == "the first argument is the number of the step, an integer; got Tensor."
    with pytest.raises(InputError) as caught:
        monitor(0, torch.stack([BALL, TORUS]))
    assert str(caught.value) == "a monitor watches one field; got a batch of 2. Use one monitor for each."
    with pytest.raises(InputError, match=r"^expected a field .* got ndarray\.$"):
        monitor(0, BALL.numpy())
