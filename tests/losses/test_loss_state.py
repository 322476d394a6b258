"""The losses keep what they remember through copies, pickles and checkpoints."""

from __future__ import annotations

import copy
import io
import pickle
from collections.abc import Callable
from functools import partial

import pytest
import torch
from analytic_fields import ball, block, grid, torus, union
from torch import Tensor, nn

import topokit as tk
from topokit.errors import InputError
from topokit.losses import SearchOptions
from topokit.losses.field_loss import FieldLoss
from topokit.testing import torus_samples

P = grid(20)
TORUS = torus(P, 0.5, 0.25)
TWO = union(ball(P, 0.4, (-0.5, 0, 0)), torus(P, 0.28, 0.14, (0.55, 0, 0)))
SAMPLES = torus_samples(1500, major=1.0, minor=0.5, generator=torch.Generator().manual_seed(1))


def cut_ring(thickness: float) -> Tensor:
    """The torus, cut nearly through at one place: it is cheaper to break than to fill."""
    cut = -block(P, (0.15, 0.4, 0.4), (0, 0.5, 0)) + thickness
    return torch.minimum(TORUS, cut.clamp_min(-0.5))


def through_pickle(loss: FieldLoss) -> FieldLoss:
    return pickle.loads(pickle.dumps(loss))


def through_saved_module(loss: FieldLoss) -> FieldLoss:
    file = io.BytesIO()
    torch.save(loss, file)
    file.seek(0)
    return torch.load(file, weights_only=False)


def through_checkpoint(make: Callable[[], FieldLoss], loss: FieldLoss) -> FieldLoss:
    """The state of a training: a model and its loss, saved and loaded as tensors and numbers only."""
    file = io.BytesIO()
    torch.save(nn.ModuleDict({"net": nn.Linear(3, 1), "loss": loss}).state_dict(), file)
    file.seek(0)
    resumed = nn.ModuleDict({"net": nn.Linear(3, 1), "loss": make()})
    resumed.load_state_dict(torch.load(file, weights_only=True))
    return resumed["loss"]


def closing() -> tk.TopologyLoss:
    return tk.TopologyLoss(genus=0, search=SearchOptions(search_every=1000))


def by_component() -> tk.TopologyLoss:
    return tk.TopologyLoss(genus=(0, 0), search=SearchOptions(evaluate_every=3))


def closing_samples() -> tk.TopologyLoss:
    return tk.TopologyLoss(genus=0, resolution=40)


def euler_of_samples() -> tk.EulerLoss:
    return tk.EulerLoss(2.0, resolution=40)


def moved_samples(shift: float) -> tk.Shape:
    return tk.from_points(SAMPLES.points + shift, SAMPLES.normals)


CASES: list[tuple[Callable[[], FieldLoss], list[Tensor | tk.Shape]]] = [
    (closing, [TORUS, TORUS - 0.02, cut_ring(0.05)]),
    (by_component, [TWO, TWO - 0.01, TWO - 0.02, TWO + 0.01, TWO + 0.02]),
    (closing_samples, [moved_samples(0.0), moved_samples(0.03)]),
    (euler_of_samples, [moved_samples(0.0), moved_samples(0.03)]),
]


@pytest.mark.parametrize(("make", "sources"), CASES, ids=[make.__name__ for make, _ in CASES])
@pytest.mark.parametrize("way", ["deepcopy", "pickle", "torch.save", "state_dict"])
def test_a_copy_goes_on_as_the_loss_itself(
    make: Callable[[], FieldLoss], sources: list[Tensor | tk.Shape], way: str
) -> None:
    copies: dict[str, Callable[[FieldLoss], FieldLoss]] = {
        "deepcopy": copy.deepcopy,
        "pickle": through_pickle,
        "torch.save": through_saved_module,
        "state_dict": partial(through_checkpoint, make),
    }
    loss, last = make(), sources[-1]
    for source in sources[:-1]:
        loss(source)
    twin = copies[way](loss)
    fresh = make()(last)
    expected = [loss(last), loss(last)]
    assert [twin(last), twin(last)] == expected
    assert expected[0] != fresh  # so the memory does matter here


def test_copies_do_not_share_their_memory() -> None:
    loss = closing()
    loss(TORUS)
    twins = [copy.deepcopy(loss), through_checkpoint(closing, loss)]
    for twin in twins:
        twin(cut_ring(0.05))
        twin.reset()
    assert loss(TORUS) == tk.topology_loss(TORUS, 0)


def test_the_state_of_an_unused_loss_can_be_loaded() -> None:
    used = closing()
    used(TORUS)
    used.load_state_dict(closing().state_dict())
    assert used(cut_ring(0.05)) == closing()(cut_ring(0.05))


def test_the_state_of_another_goal_is_refused() -> None:
    with pytest.raises(InputError) as caught:
        tk.TopologyLoss(genus=1, change="add").load_state_dict(closing().state_dict())
    assert "((1, 0, 0), (), 'any')" in str(caught.value)
    assert "((1, 1, 0), (), 'add')" in str(caught.value)


def test_tracks_are_kept_for_a_grid_and_forgotten_for_another() -> None:
    loss = tk.TopologyLoss(genus=0)
    loss(TORUS, 0.05)
    known = loss.tracker._tracks[0]
    loss(TORUS + 0.01, 0.05)
    assert loss.tracker._tracks[0] is known
    other = torus(grid(16), 0.5, 0.25)
    assert loss(other, 0.05) == tk.topology_loss(other, 0, 0.05)
    assert loss.tracker._tracks[0] is not known
    loss(torch.stack([TORUS, -TORUS]), 0.05)
    assert len(loss.tracker._tracks) == 2
    loss.reset()
    assert loss.tracker._tracks == []
