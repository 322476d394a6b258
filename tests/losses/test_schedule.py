"""The schedule of τ."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
import torch
from analytic_fields import ball, grid, torus
from torch import Tensor

import topokit as tk
from topokit.core.grid.field import default_tau
from topokit.errors import InputError
from topokit.losses import TauSchedule
from topokit.testing import torus_samples

P = grid(16)
BALL = ball(P, 0.6)
TORUS = torus(P, 0.5, 0.25)


def test_tau_falls_geometrically_and_stays_at_the_end() -> None:
    schedule = TauSchedule(0.8, 0.1, 10)
    taus = [schedule(step) for step in range(12)]
    assert taus[0] == 0.8
    assert taus[8:] == pytest.approx([0.1] * 4)
    for before, after in itertools.pairwise(taus[:9]):
        assert after / before == pytest.approx((0.1 / 0.8) ** (1 / 8))
    assert TauSchedule(0.1, 0.1, 1)(0) == 0.1


def test_a_schedule_goes_from_the_spread_of_the_field_to_the_default_tau() -> None:
    schedule = TauSchedule.for_field(TORUS, 50)
    assert schedule.finest == default_tau(TORUS)
    assert schedule.coarsest == pytest.approx(float(TORUS.abs().median()))
    assert schedule.n_steps == 50
    assert TauSchedule.for_field(TORUS + 3, 50, level=3.0).finest == pytest.approx(schedule.finest)
    with_infinities = torch.where(TORUS < -0.4, -math.inf, TORUS)
    assert math.isfinite(TauSchedule.for_field(with_infinities, 50).coarsest)
    binary = TauSchedule.for_field(TORUS.sign(), 50)
    assert (binary.finest, binary.coarsest) == (1.0, 1.0)
    flat_outside = TauSchedule.for_field(torch.where(BALL > 0, 1.0, -0.01), 50)
    assert flat_outside.coarsest == flat_outside.finest == pytest.approx(0.505)


def test_a_schedule_evaluates_a_network_once() -> None:
    calls = []

    def sdf(points: Tensor) -> Tensor:
        calls.append(len(points))
        return points.norm(dim=1) - 0.6

    shape = tk.from_sdf(sdf, bounds=((-1,) * 3, (1,) * 3), field_resolution=16)
    calls.clear()
    TauSchedule.for_field(shape, 10)
    assert sum(calls) == 17**3


def test_a_schedule_for_samples_uses_the_resolution_of_the_loss() -> None:
    cloud = torus_samples(1500, major=1.0, minor=0.5, generator=torch.Generator().manual_seed(1))
    shape = tk.from_points(cloud.points, cloud.normals)
    loss = tk.TopologyLoss(genus=0, resolution=32)
    assert TauSchedule.for_field(shape, 10, resolution=32).finest == default_tau(loss.source(shape)[0].detached())
    assert TauSchedule.for_field(shape, 10, resolution=32) != TauSchedule.for_field(shape, 10)


@pytest.mark.parametrize("numbers", [(0.1, 0.2), (0.1, 0.0), (math.inf, 0.1), (math.nan, 0.1)])
def test_the_range_of_a_schedule_is_checked(numbers: tuple[float, float]) -> None:
    with pytest.raises(InputError) as caught:
        TauSchedule(*numbers, 10)
    assert str(caught.value) == (
        f"a schedule needs 0 < finest <= coarsest < ∞; got finest={numbers[1]:g}, coarsest={numbers[0]:g}."
    )


@pytest.mark.parametrize("n_steps", [0, 2.5, "10"])
def test_the_number_of_steps_is_checked(n_steps: Any) -> None:
    with pytest.raises(InputError) as caught:
        TauSchedule(0.2, 0.1, n_steps)
    assert str(caught.value) == f"n_steps must be an integer of at least 1, not {n_steps!r}."


def test_a_schedule_needs_one_field_with_both_signs() -> None:
    with pytest.raises(InputError, match=r"^a schedule is for one field; got a batch of 2\.$"):
        TauSchedule.for_field(torch.stack([BALL, TORUS]), 10)
    with pytest.raises(InputError, match="has the same sign at all points"):
        TauSchedule.for_field(torch.ones(4, 4, 4), 10)
