"""The schedule of τ, the monitor, and critical points made visible."""

from __future__ import annotations

import itertools
import logging
import math

import pytest
import torch
from analytic_fields import ball, grid, torus, union, without

import topokit as tk
from topokit.core.grid.euler import smoothed_euler, solid_euler
from topokit.core.grid.field import median_step_at_crossings
from topokit.errors import InputError
from topokit.losses import CriticalPoints, TauSchedule, TopologyRecord, critical_points
from topokit.testing import torus_samples

DOUBLE = torch.float64
P = grid(16)
BALL = ball(P, 0.6)
TORUS = torus(P, 0.5, 0.25)
SHELL = without(BALL, ball(P, 0.3))

# the schedule


def test_tau_falls_geometrically_and_stays_at_the_end():
    schedule = TauSchedule(0.8, 0.1, 10)
    taus = [schedule(step) for step in range(12)]
    assert taus[0] == 0.8
    assert taus[8:] == pytest.approx([0.1] * 4)
    for before, after in itertools.pairwise(taus[:9]):
        assert after / before == pytest.approx((0.1 / 0.8) ** (1 / 8))
    assert TauSchedule(0.1, 0.1, 1)(0) == 0.1


def test_a_schedule_is_found_from_the_field():
    schedule = TauSchedule.for_field(TORUS, 50)
    assert schedule.finest == pytest.approx(0.5 * median_step_at_crossings(TORUS))
    assert schedule.coarsest == pytest.approx(float(TORUS.abs().median()))
    assert schedule.n_steps == 50
    assert TauSchedule.for_field(TORUS + 3, 50, level=3.0).finest == pytest.approx(schedule.finest)
    walled = torch.where(TORUS < -0.4, -math.inf, TORUS)
    assert math.isfinite(TauSchedule.for_field(walled, 50).coarsest)
    steep = TauSchedule.for_field(TORUS.sign(), 50)  # as coarse as it is fine
    assert (steep.finest, steep.coarsest) == (1.0, 1.0)
    flat = TauSchedule.for_field(torch.where(BALL > 0, 1.0, -0.01), 50)
    assert flat.coarsest == flat.finest == pytest.approx(0.505)


def test_a_schedule_evaluates_a_network_once():
    calls = []
    shape = tk.from_sdf(
        lambda x: calls.append(len(x)) or x.norm(dim=1) - 0.6, bounds=((-1,) * 3, (1,) * 3), field_resolution=16
    )
    calls.clear()
    TauSchedule.for_field(shape, 10)
    assert sum(calls) == 17**3


@pytest.mark.parametrize(
    "numbers", [(0.1, 0.2, 10), (0.1, 0.0, 10), (math.inf, 0.1, 10), (0.2, 0.1, 0), (math.nan, 0.1, 1)]
)
def test_a_schedule_needs_sensible_numbers(numbers):
    with pytest.raises(InputError) as caught:
        TauSchedule(*numbers)
    assert str(caught.value) == (
        f"a schedule needs 0 < finest <= coarsest < ∞ and n_steps >= 1, got finest={numbers[1]:g}, "
        f"coarsest={numbers[0]:g} and n_steps={numbers[2]}."
    )


def test_a_schedule_is_of_one_field_that_changes_its_sign():
    with pytest.raises(InputError, match=r"^a schedule is that of one field; got a batch of 2\.$"):
        TauSchedule.for_field(torch.stack([BALL, TORUS]), 10)
    with pytest.raises(InputError, match="has the same sign at all points"):
        TauSchedule.for_field(torch.ones(4, 4, 4), 10)


# the monitor


def test_the_monitor_counts_when_it_is_time_and_logs_a_line(caplog):
    asked = []
    monitor = tk.TopologyMonitor(every=10)
    with caplog.at_level(logging.INFO, logger="topokit"):
        for step, field in enumerate([SHELL] * 15 + [TORUS] * 15):
            assert not monitor(step, lambda given=field: asked.append(1) or given)
    assert len(asked) == 3
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


def test_patience_counts_successes_in_succession():
    monitor = tk.TopologyMonitor(genus=0, every=1, patience=2)
    fields = [BALL, TORUS, BALL, BALL, BALL, SHELL]
    assert [monitor(step, field) for step, field in enumerate(fields)] == [False, False, False, True, True, False]


@pytest.mark.parametrize(
    ("goal", "right", "wrong"),
    [
        ({"genus": 0}, BALL, TORUS),
        ({"target": 4.0, "cavities": 1}, SHELL, BALL),
        ({"target": 2.0}, BALL, union(TORUS, ball(P, 0.2, (0.8, 0.8, 0.8)))),
        ({"target": 0.0, "components": None}, TORUS, BALL),
    ],
)
def test_what_the_goal_is(goal, right, wrong):
    for field, is_met in ((right, True), (wrong, False)):
        assert tk.TopologyMonitor(every=1, patience=1, **goal)(0, field) == is_met


def test_each_component_is_asked_for_its_own_topology():
    field = union(ball(P, 0.4, (-0.5, 0, 0)), torus(P, 0.25, 0.14, (0.55, 0, 0)))
    for genus, is_met in (((0, 1), True), ((1, 0), False)):
        assert tk.TopologyMonitor(genus=genus, every=1, patience=1)(0, field) == is_met


def test_the_monitor_takes_what_the_loss_takes():
    def counted(source: object, **options: object) -> int:
        monitor = tk.TopologyMonitor(every=1, **options)
        monitor(0, source)
        return monitor.history[0].euler

    assert counted(TORUS.half()) == counted(TORUS + 5, level=5.0) == counted(TORUS[None]) == 0
    diagonal = torch.eye(3)[..., None] - 0.5
    assert (counted(diagonal), counted(diagonal, connectivity=26)) == (6, 2)
    assert counted(tk.from_voxels(TORUS, level=0.0)) == 0
    cloud = torus_samples(1500, major=1.0, minor=0.5, generator=torch.Generator().manual_seed(1))
    assert counted(tk.from_points(cloud.points, cloud.normals), resolution=48) == 0


def test_what_the_monitor_refuses():
    for every, patience in ((0, 1), (1, 0)):
        with pytest.raises(InputError) as caught:
            tk.TopologyMonitor(every=every, patience=patience)
        assert str(caught.value) == f"every and patience must be at least 1, got {every} and {patience}."
    with pytest.raises(InputError) as caught:
        tk.TopologyMonitor()(0, torch.stack([BALL, TORUS]))
    assert str(caught.value) == "a monitor watches one field; got a batch of 2. Use one monitor for each."
    with pytest.raises(InputError, match="no closed surface"):
        tk.TopologyMonitor(target=3.0)


# critical points


def saddle_field(*signs: int) -> torch.Tensor:
    """± x² ± y² ± z², with a slight slope so that no two voxels tie."""
    axis = torch.arange(-2.0, 3.0, dtype=DOUBLE)
    squares = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij")).square()
    slope = torch.arange(125, dtype=DOUBLE).reshape(5, 5, 5) * 1e-4
    return (torch.tensor(signs, dtype=DOUBLE)[:, None, None, None] * squares).sum(0) + slope


def at_the_middle(points: CriticalPoints) -> tuple[str, int] | None:
    """Kind and index of the critical point among the middle 3 x 3 x 3 voxels."""
    near = ((points.voxels - 2).abs() <= 1).all(1).nonzero().flatten().tolist()
    assert len(near) == 1
    return points.kinds[near[0]], int(points.index[near[0]])


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize(
    ("signs", "kind", "index"),
    [
        ((-1, -1, -1), "appears", 1),
        ((1, -1, -1), "joins", -1),
        ((-1, -1, 1), "joins", -1),
        ((1, 1, -1), "closes", 1),
        ((-1, 1, 1), "closes", 1),
        ((1, 1, 1), "fills", -1),
    ],
)
def test_maximum_saddles_and_minimum(signs, kind, index, connectivity):
    points = critical_points(saddle_field(*signs), 2.0, 0.5, connectivity=connectivity)
    assert at_the_middle(points) == (kind, index)


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("rounded", [False, True])
def test_indices_sum_to_the_euler_characteristic_and_agree_with_the_kinds(connectivity, rounded, generator):
    field = torch.randn(7, 6, 8, generator=generator, dtype=DOUBLE)
    field = (2 * field).round() / 2 if rounded else field  # ties
    points = critical_points(field, 2.0, 0.5, level=0.25, connectivity=connectivity)
    assert points.index[points.values > 0].sum() == solid_euler(field, 0.25, connectivity)
    assert (points.values.abs().diff() >= 0).all()
    torch.testing.assert_close(points.values, field[tuple(points.voxels.T)] - 0.25)
    expected = {"appears": 1, "joins": -1, "closes": 1, "fills": -1}
    for kind, index in zip(points.kinds, points.index.tolist(), strict=True):
        if kind == "joins":
            assert index < 0  # several parts may join at once
        elif kind == "closes":
            assert index > 0
        else:
            assert kind == "several" or index == expected[kind], (kind, index)
    assert {"appears", "joins", "closes"} <= set(points.kinds)


@pytest.mark.parametrize("connectivity", [6, 26])
def test_the_push_is_what_autograd_says_and_goes_the_right_way(connectivity, generator):
    field = torch.randn(6, 6, 6, generator=generator, dtype=DOUBLE, requires_grad=True)
    loss = (smoothed_euler(field, 0.4, 0.1, connectivity) - 2).square()
    (slope,) = torch.autograd.grad(loss, field)
    points = critical_points(field, 2.0, 0.4, level=0.1, connectivity=connectivity)
    torch.testing.assert_close(points.push, -slope[tuple(points.voxels.T)])
    torch.testing.assert_close(points.push.sum(), -slope.sum())
    rises = points.push * (2.0 - smoothed_euler(field, 0.4, 0.1, connectivity).detach()).sign() > 0
    assert (rises == (points.index > 0)).all()  # what raises χ is raised when χ is too low


def test_the_hole_of_a_torus_is_closed_by_raising_a_saddle():
    points = critical_points(TORUS + 0.02 * P[..., 2], 2.0, 0.2)
    in_the_hole = P[tuple(points.voxels.T)].norm(dim=1) < 0.2
    closing = [k for k, kind in enumerate(points.kinds) if kind == "closes" and in_the_hole[k]]
    assert len(closing) == 1
    assert points.push[closing[0]] > 0
    assert points.values[closing[0]] < 0


def test_forms_and_refusals_of_critical_points():
    for dtype in (torch.float16, torch.bfloat16, torch.float32):
        points = critical_points(TORUS.to(dtype), 2.0, 0.1)
        assert points.push.isfinite().all()
    with torch.no_grad():
        assert len(critical_points(TORUS, 2.0, 0.1).voxels) > 0
    one = critical_points(torch.full((1, 1, 1), 0.5), 0.0, 1.0)
    assert (one.voxels.tolist(), one.kinds, one.index.tolist()) == ([[0, 0, 0]], ("appears",), [1])
    said = "critical points are those of one finite floating-point field (X, Y, Z); got {}, {}."
    for field in (TORUS[None], torch.ones(2, 2, 2, dtype=torch.int64), torch.full((2, 2, 2), math.inf)):
        with pytest.raises(InputError) as caught:
            critical_points(field, 2.0, 0.1)
        assert str(caught.value) == said.format(tuple(field.shape), field.dtype)
    for options in ({"tau": 0.0}, {"tau": 0.1, "connectivity": 18}):
        with pytest.raises(InputError):
            critical_points(TORUS, 2.0, **options)
