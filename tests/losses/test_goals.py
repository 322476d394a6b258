"""What can be asked for: Betti numbers, at most some, those of each item or channel, plane fields, targets in place."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from analytic_fields import ball, grid, rod, torus, union, without
from torch import Tensor

import topokit as tk
from topokit.core.grid.betti import betti_numbers
from topokit.errors import InputError
from topokit.losses.field_loss import CountedSolid

P = grid(20)
BALL, TORUS = ball(P, 0.5), torus(P, 0.5, 0.25)
TWO = union(ball(P, 0.4, (-0.5, 0, 0)), ball(P, 0.3, (0.55, 0, 0)))


def trained(start: Tensor, loss: tk.TopologyLoss, steps: int = 60, **goals: Any) -> Tensor:
    """The field after a training that holds it near its start."""
    field = start.clone().requires_grad_()
    optimizer = torch.optim.Adam([field], 0.02)
    for _ in range(steps):
        optimizer.zero_grad()
        (loss(field, keys="it", **goals) + (field - start).square().mean()).backward()
        optimizer.step()
    return field.detach()


@pytest.mark.parametrize("betti", [(1, 0, 0), [2, 0, 0], np.array([1, 1, 0]), torch.tensor([1, 2, 1])], ids=str)
def test_betti_numbers_are_the_goal_that_genus_is_short_for(betti: Any) -> None:
    components, tunnels, cavities = map(int, betti)
    long, short = tk.TopologyLoss(betti=betti), tk.TopologyLoss(tunnels, components=components, cavities=cavities)
    assert long.goal is not None
    assert short.goal is not None
    assert long.goal.betti == short.goal.betti == (components, tunnels, cavities)


def test_each_item_has_its_goal() -> None:
    fields = torch.stack([TORUS, TORUS, TWO])
    loss = tk.TopologyLoss(betti=(1, 0, 0), reduction="none")
    rows = torch.tensor([(1, 1, 0), (1, 0, 0), (2, 0, 0)])
    values = loss(fields, 1e-6, betti=rows)
    assert (values > 0).tolist() == [False, True, False]
    assert values[1] == tk.topology_loss(TORUS, 0, 1e-6)
    assert (loss(fields, 1e-6) > 0).tolist() == [True, True, True]


def test_a_row_for_each_channel() -> None:
    fields = torch.stack([torch.stack([BALL, TORUS]), torch.stack([TORUS, BALL])])
    loss = tk.TopologyLoss(betti=[(1, 0, 0), (1, 1, 0)], change="add", reduction="none")
    with pytest.warns(UserWarning, match=r"the Betti numbers \(1, 1, 0\) is in reach for batch item \(1, 1\)"):
        values = loss(fields, 1e-6)
    assert (values > 0).tolist() == [[False, False], [True, False]]


def test_at_most_leaves_what_is_fewer_and_removes_what_is_more() -> None:
    loss = tk.TopologyLoss(betti=(1, 1, 0), at_most=True, change="remove")
    assert loss.is_met(CountedSolid(BALL, 26))
    assert not loss.is_met(CountedSolid(TWO, 26))
    for field in (BALL, TORUS, -torch.rand(8, 8, 8)):
        assert loss(field, 1e-6) == 0
    blob = union(torus(P, 0.4, 0.2), ball(P, 0.15, (0.8, 0.8, 0.8)))
    assert betti_numbers(trained(blob, loss)).tolist() == [1, 1, 0]  # not [1, 0, 0]


def test_plane_fields() -> None:
    x, y = P[:, :, 0, 0], P[:, :, 0, 1]
    ring = 0.2 - (torch.hypot(x, y) - 0.5).abs()
    blob = torch.maximum(ring, 0.2 - torch.hypot(x - 0.75, y - 0.75))
    for start, betti in ((ring, (1, 0)), (blob, (1, 1)), (blob, (2, 1))):
        loss = tk.TopologyLoss(betti=betti)
        field = trained(start, loss, 80)
        for connectivity in (6, 26):
            assert betti_numbers(field[..., None], connectivity=connectivity).tolist() == [*betti, 0]
    assert tk.TopologyLoss(betti=(1, 1), reduction="none")(torch.stack([ring, ring])).shape == (2,)


def test_a_target_is_reached_in_place() -> None:
    """A field with one of the two tunnels of the target, and with another one that the target does not have."""
    plate = torch.minimum(0.75 - P[..., :2].abs().amax(-1), 0.25 - P[..., 2].abs())

    def holes(*places: tuple[float, float]) -> Tensor:
        return without(plate, *(rod(P, 0.18, 2, center=(*place, 0)) for place in places))

    target = holes((-0.4, -0.4), (-0.4, 0.4)) > 0
    start = holes((-0.4, -0.4), (0.4, 0.4))
    assert betti_numbers(start).tolist() == betti_numbers(target).tolist() == [1, 2, 0]
    assert tk.topology_loss(start, betti=(1, 2, 0), tau=1e-6) == 0
    field = trained(start, tk.TopologyLoss(), target=target)
    assert betti_numbers(field).tolist() == [1, 2, 0]
    middle = 10  # of the plate
    tunnel = [field[4:8, y, middle].amin() < 0 for y in (slice(4, 8), slice(12, 16))]
    assert tunnel == [True, True]
    assert (field[12:16, 12:16, middle] > 0).any(-1).all()


def test_the_start_as_target_keeps_the_topology() -> None:
    """The data term pulls to two balls; the solid of the start holds the ring together."""
    start, loss = TORUS.clone(), tk.TopologyLoss()
    data = torch.where(P[..., 0].abs() < 0.25, -0.2, TORUS)
    for weight in (0, 1):
        field = start.clone().requires_grad_()
        optimizer = torch.optim.Adam([field], 0.02)
        for _ in range(60):
            optimizer.zero_grad()
            (weight * loss(field, target=start > 0) + (field - data).square().mean()).backward()
            optimizer.step()
        assert betti_numbers(field.detach()).tolist() == ([1, 1, 0] if weight else [2, 0, 0])


def test_a_field_that_has_left_its_level_is_brought_back() -> None:
    start = (BALL - 1).requires_grad_()
    optimizer = torch.optim.Adam([start], 0.05)
    loss = tk.TopologyLoss(betti=(1, 0, 0))
    for _ in range(60):
        optimizer.zero_grad()
        loss(start, keys="it").backward()
        optimizer.step()
    assert betti_numbers(start.detach()).tolist() == [1, 0, 0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tk.TopologyLoss()(BALL), "there is no goal: make the loss with genus"),
        (lambda: tk.TopologyLoss(betti=1), "betti must be (components, tunnels, cavities)"),
        (lambda: tk.TopologyLoss(betti=(1, 0, -1)), "as integers of at least 0"),
        (lambda: tk.TopologyLoss(betti=(1.0, 0, 0)), "as integers of at least 0"),
        (lambda: tk.TopologyLoss(betti="unchanged"), "got 'unchanged'"),
        (lambda: tk.TopologyLoss(0, betti=(1, 0, 0)), "not both"),
        (lambda: tk.TopologyLoss((0, 0), at_most=True), "at_most=False; got 2"),
        (
            lambda: tk.topology_loss(BALL, betti=[(1, 0, 0)] * 2),
            "betti has the shape (2, 3); it must broadcast to (3,)",
        ),
        (lambda: tk.TopologyLoss()(BALL, target=BALL), "target must be a mask"),
        (lambda: tk.TopologyLoss()(BALL, target=BALL[1:] > 0), "must broadcast to (20, 20, 20)"),
        (lambda: tk.TopologyLoss()(BALL, betti=(1, 0, 0), target=BALL > 0), "pass betti or target, not both"),
    ],
)
def test_wrong_goals_are_named(call: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert message in str(caught.value)


@pytest.mark.parametrize(("logits", "power"), [(False, 2), (True, 1)])
def test_slopes_of_log_odds_do_not_grow_with_them(logits: bool, power: int) -> None:
    """Beside a squared error it is in squared units; beside a cross-entropy, whose slopes are bounded, it is not."""

    def hole(x: Tensor) -> Tensor:
        ring = torch.hypot(x[:, 0], x[:, 1]) - 0.5
        return 0.3 - torch.hypot(ring, x[:, 2])

    def loss_of(scale: float) -> Tensor:
        options = {"bounds": (-1, 1), "field_resolution": 16}
        one = tk.from_occupancy(lambda x: scale * hole(x), logits=logits, level=0.5 if logits else 0.0, **options)
        return tk.topology_loss(one, betti=(1, 0, 0))

    assert float(loss_of(10.0)) == pytest.approx(10.0**power * float(loss_of(1.0)), rel=1e-4)
    assert float(loss_of(1.0)) > 0
