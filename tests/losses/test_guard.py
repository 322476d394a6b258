"""The guard: which voxels decide the topology, how the solid follows a field, and when another solid replaces it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from analytic_fields import ball, block, grid, torus, union

from topokit.core.grid.betti import betti_numbers
from topokit.core.grid.field import GridField
from topokit.losses import guard as module
from topokit.losses.goal import Goal
from topokit.losses.guard import DecisiveVoxels, Guard, Memory
from topokit.losses.topology import STIFFNESS, margin_loss

P = grid(20)
TORUS = torus(P, 0.5, 0.25).numpy()
BALL = ball(P, 0.5).numpy()
AS_BALL, AS_TORUS = Goal((1, 0, 0)), Goal((1, 1, 0))


def cut_torus(thickness: float) -> np.ndarray:
    """The torus, cut nearly through in one place: deeper for smaller numbers."""
    cut = -block(P, (0.15, 0.4, 0.4), (0, 0.5, 0)).numpy() + thickness
    return np.minimum(TORUS, np.maximum(cut, -0.5))


def solid_of(memory: Memory) -> np.ndarray:
    return memory["solid"].numpy()


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """The arguments of each search for a nearest solid."""
    calls: list[tuple[Any, ...]] = []
    search = module.nearest_solid
    monkeypatch.setattr(module, "nearest_solid", lambda *given: calls.append(given) or search(*given))
    return calls


def test_decisive_voxels_are_short_of_their_side_and_not_simple() -> None:
    memory: Memory = {}
    decisive = Guard("add").update(TORUS, AS_BALL, 0.05, memory)
    solid, at = solid_of(memory), tuple(decisive.voxels.T.numpy())
    assert decisive.sides.tolist() == np.where(solid[at], 1.0, -1.0).tolist()
    assert (decisive.sides.numpy() * TORUS[at] < 0.05).all()
    missing = solid & (TORUS <= 0)
    assert missing.sum() > 3
    assert set(map(tuple, np.argwhere(missing).tolist())) <= set(map(tuple, decisive.voxels.tolist()))
    assert len(Guard("add").update(BALL, AS_BALL, 0.001, {}).voxels) == 0


def test_decisive_voxels_are_held_at_the_margin() -> None:
    thin = cut_torus(0.12)
    few, more = (Guard().update(thin, AS_TORUS, margin, {}) for margin in (0.05, 0.1))
    depths = few.sides.numpy() * thin[tuple(few.voxels.T.numpy())]
    assert len(few.voxels) > 0
    assert ((depths > 0) & (depths < 0.05)).all()
    assert len(few.voxels) < len(more.voxels) < 80


def test_searches_come_when_due_and_only_while_the_topology_is_wrong(searches: list[tuple[Any, ...]]) -> None:
    guard, memory, counts = Guard(search_every=3), {}, []
    for field in 4 * [TORUS] + 4 * [BALL] + 2 * [TORUS]:
        guard.update(field, AS_BALL, 0.05, memory)
        counts.append(len(searches))
    assert counts == [1, 1, 1, 2, 2, 2, 2, 2, 2, 3]


def test_the_known_solid_follows_the_field_between_searches(searches: list[tuple[Any, ...]]) -> None:
    guard, memory = Guard("add", 1000), {}
    guard.update(TORUS, AS_BALL, 0.05, memory)
    smaller = TORUS - 0.1
    guard.update(smaller, AS_BALL, 0.05, memory)
    assert len(searches) == 1
    assert betti_numbers(solid_of(memory)).tolist() == [1, 0, 0]
    assert (solid_of(memory) >= (smaller > 0)).all()
    assert 0 < (solid_of(memory) & (smaller <= 0)).sum() < 0.2 * (smaller > 0).sum()
    guard.update(BALL, AS_BALL, 0.05, memory)
    assert (solid_of(memory) == (BALL > 0)).all()


def test_the_solid_is_replaced_only_by_a_much_cheaper_one() -> None:
    """The known solid has a membrane in the hole; a cut through the ring replaces it below half of its cost."""
    for thickness, cuts in ((0.2, False), (0.16, True)):
        memory: Memory = {}
        field = cut_torus(thickness)
        assert betti_numbers(field).tolist() == [1, 1, 0]
        Guard("add", 1).update(field, AS_BALL, 0.05, memory)
        assert (solid_of(memory) >= (field > 0)).all()
        Guard("any", 1).update(field, AS_BALL, 0.05, memory)
        assert (solid_of(memory) < (field > 0)).any() == cuts


def test_infinite_values_are_the_last_to_be_moved_at_any_scale() -> None:
    """One of two parts has to go: not the one that is infinite."""
    for scale in (0.01, 1.0, 1000.0):
        field = scale * union(ball(P, 0.4, (-0.4, 0, 0)), ball(P, 0.3, (0.6, 0, 0))).numpy()
        endless = np.where((field > 0) & (P[..., 0] > 0).numpy(), math.inf, field)
        decisive = Guard("remove").update(endless, AS_BALL, 0.01 * scale, {})
        voxels = P[tuple(decisive.voxels.T)]
        assert len(voxels) > 50
        assert (voxels[:, 0] < 0.1).all()
        assert (decisive.sides == -1).all()


def test_the_result_is_none_until_a_search_succeeds() -> None:
    guard, memory = Guard("add", 2), {}
    assert guard.update(BALL, AS_TORUS, 0.05, memory) is None
    assert guard.update(TORUS, AS_TORUS, 0.05, memory) is None
    assert guard.update(TORUS, AS_TORUS, 0.05, memory) is not None


def test_the_margin_loss_is_a_huber_loss_of_shortfalls_in_units_of_the_field() -> None:
    field = torch.tensor([[[0.3, -0.1, 0.1, 5.0]]], dtype=torch.float64, requires_grad=True)
    voxels = torch.tensor([[0, 0, 0], [0, 0, 1], [0, 0, 2], [0, 0, 3]])
    sides = torch.tensor([-1.0, 1.0, 1.0, 1.0], dtype=torch.float64)
    loss = margin_loss(GridField(field), 10, DecisiveVoxels(voxels, sides), 0.2)
    shortfalls = [1 + 1.5, 1.5, 0.5, 0.0]  # in margins; quadratic below 1
    errors = sum(s - 0.5 if s > 1 else s * s / 2 for s in shortfalls)
    assert loss.item() == pytest.approx(STIFFNESS * 0.2**2 / 10 * errors)
    (slope,) = torch.autograd.grad(loss, field)
    assert slope.flatten().tolist() == pytest.approx([STIFFNESS * 0.02 * one for one in (1, -1, -0.5, 0)])


def test_each_component_is_changed_in_its_own_region() -> None:
    left, right = ball(P, 0.45, (-0.5, 0, 0)), torus(P, 0.28, 0.14, (0.55, 0, 0))
    field = union(left, right).numpy()

    def of(*wanted: tuple[int, int, int]) -> Goal:
        return Goal((2, 0, 0), wanted)

    decisive = Guard("add").update(field, of((1, 0, 0), (1, 0, 0)), 0.02, {})
    to_add = decisive.voxels[decisive.sides > 0]
    to_add = to_add[field[tuple(to_add.T.numpy())] <= 0]
    assert len(to_add) > 0
    assert (P[tuple(to_add.T)][:, 0] > 0.2).all()  # the hole of the torus
    assert Guard("add").update(field, of((1, 5, 0), (1, 1, 0)), 0.02, {}) is None
    assert len(Guard().update(field, of((1, 0, 0), (1, 1, 0)), 1e-6, {}).voxels) == 0


def test_without_decisive_voxels_the_loss_is_zero_and_has_a_graph() -> None:
    field = torch.rand(3, 3, 3, requires_grad=True)
    none = DecisiveVoxels(torch.zeros(0, 3, dtype=torch.int64), torch.zeros(0, dtype=torch.float64))
    for decisive in (None, none):
        (slope,) = torch.autograd.grad(margin_loss(GridField(field), 27, decisive, 0.2), field)
        assert slope.count_nonzero() == 0
