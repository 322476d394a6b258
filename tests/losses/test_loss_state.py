"""Without keys a loss knows nothing from call to call; with keys it knows, in copies and checkpoints, too."""

from __future__ import annotations

import copy
import io
import pickle
from collections.abc import Callable

import pytest
import torch
from analytic_fields import ball, block, grid, torus, union
from torch import Tensor, nn
from torch.utils.data import DataLoader

import topokit as tk
from topokit.errors import InputError
from topokit.testing import torus_samples

P = grid(20)
TORUS = torus(P, 0.5, 0.25)
TWO = union(ball(P, 0.4, (-0.5, 0, 0)), torus(P, 0.28, 0.14, (0.55, 0, 0)))
SAMPLES = torus_samples(1500, major=1.0, minor=0.5, generator=torch.Generator().manual_seed(1))


def cut_ring(thickness: float) -> Tensor:
    """The torus, cut nearly through at one place: it is cheaper to break than to fill."""
    cut = -block(P, (0.15, 0.4, 0.4), (0, 0.5, 0)) + thickness
    return torch.minimum(TORUS, cut.clamp_min(-0.5))


def slope(loss: tk.TopologyLoss, field: Tensor, **options: object) -> Tensor:
    leaf = field.clone().requires_grad_()
    return torch.autograd.grad(loss(leaf, **options), leaf)[0]


def test_a_shuffled_data_loader_gets_what_a_fresh_loss_gives() -> None:
    """Of unrelated fields in random order; the voxels that are pushed, and how, are equal to the last digit."""
    generator = torch.Generator().manual_seed(0)
    p = grid(12)
    fields = [torus(p, 0.5, 0.25), ball(p, 0.6), union(ball(p, 0.3, (-0.5, 0, 0)), ball(p, 0.3, (0.5, 0, 0)))]
    fields = torch.stack([one + 0.1 * torch.randn(one.shape, generator=generator) for one in 2 * fields])
    loss = tk.TopologyLoss(genus=0)
    fresh = [slope(tk.TopologyLoss(genus=0), field[None]) for field in fields]
    for _ in range(2):
        for number, field in DataLoader(list(enumerate(fields)), batch_size=1, shuffle=True, generator=generator):
            assert torch.equal(slope(loss, field), fresh[int(number)])
    assert loss._known == {}


def test_keys_keep_things_apart_and_follow_each(monkeypatch: pytest.MonkeyPatch) -> None:
    searches = []
    from topokit.losses import guard

    search = guard.nearest_solid
    monkeypatch.setattr(guard, "nearest_solid", lambda *given: searches.append(1) or search(*given))
    loss = tk.TopologyLoss(genus=0, reduction="none")
    both = torch.stack((TORUS, cut_ring(0.05)))
    expected = loss(both)
    assert len(searches) == 2
    assert torch.equal(loss(both, keys=("a", 7)), expected)
    for order in ((0, 1), (1, 0), (0, 1)):
        keys = [("a", 7)[number] for number in order]
        assert torch.equal(loss(both[list(order)], keys=keys), expected[list(order)])
        assert torch.equal(loss(both[order[0]], keys=keys[0]), expected[order[0]])
    assert len(searches) == 4
    assert torch.equal(loss(both, keys=torch.tensor([3, 4])), expected)
    assert set(loss._known) == {"a", 7, 3, 4}
    loss.forget("a")
    loss(both[0], keys="a")
    assert len(searches) == 7
    loss.forget()
    assert loss._known == {}


@pytest.mark.parametrize("keys", [("a",), ("a", "a"), (1.5, 2), (True, 2), "ab", 3])
def test_wrong_keys_are_named(keys: object) -> None:
    with pytest.raises(InputError, match="keys must be 2 different strings or integers, one for each field; got "):
        tk.TopologyLoss(genus=0)(torch.stack((TORUS, TWO)), keys=keys)


def closing() -> tk.TopologyLoss:
    return tk.TopologyLoss(genus=0, search_every=1000)


def by_component() -> tk.TopologyLoss:
    return tk.TopologyLoss(genus=(0, 0))


def closing_samples() -> tk.TopologyLoss:
    return tk.TopologyLoss(genus=0, resolution=40)


def moved_samples(shift: float) -> tk.Shape:
    return tk.from_points(SAMPLES.points + shift, SAMPLES.normals)


CASES: list[tuple[Callable[[], tk.TopologyLoss], list[Tensor | tk.Shape]]] = [
    (closing, [TORUS, TORUS - 0.02, cut_ring(0.05)]),
    (by_component, [TWO, TWO - 0.01, TWO - 0.1]),
    (closing_samples, [moved_samples(0.0), moved_samples(0.03)]),
]


def copies(make: Callable[[], tk.TopologyLoss], loss: tk.TopologyLoss) -> list[tk.TopologyLoss]:
    """By deepcopy, by pickle, and by the checkpoint of a training, saved and loaded as tensors and numbers only."""
    file = io.BytesIO()
    torch.save(nn.ModuleDict({"net": nn.Linear(3, 1), "loss": loss}).state_dict(), file)
    file.seek(0)
    resumed = nn.ModuleDict({"net": nn.Linear(3, 1), "loss": make()})
    resumed.load_state_dict(torch.load(file, weights_only=True))
    return [copy.deepcopy(loss), pickle.loads(pickle.dumps(loss)), resumed["loss"]]


@pytest.mark.parametrize(("make", "sources"), CASES, ids=[make.__name__ for make, _ in CASES])
def test_a_copy_goes_on_as_the_loss_itself(
    make: Callable[[], tk.TopologyLoss], sources: list[Tensor | tk.Shape]
) -> None:
    loss, last = make(), sources[-1]
    for source in sources[:-1]:
        loss(source, keys="it")
    twins = copies(make, loss)
    expected = [loss(last, keys="it"), loss(last, keys="it")]
    for twin in twins:
        assert [twin(last, keys="it"), twin(last, keys="it")] == expected
    if make is not by_component:
        assert expected[0] != make()(last)  # so the memory does matter here


def test_a_state_is_not_changed_by_what_comes_later() -> None:
    loss = closing()
    loss(TORUS, keys="it")
    state, expected = loss.state_dict(), loss(cut_ring(0.05), keys="it")
    loss.forget()
    other = closing()
    other.load_state_dict(state)
    assert other(cut_ring(0.05), keys="it") == expected


def test_the_state_of_another_goal_is_refused() -> None:
    with pytest.raises(InputError) as caught:
        tk.TopologyLoss(genus=1).load_state_dict(closing().state_dict())
    assert "the Betti numbers (1, 0, 0); this one is for the Betti numbers (1, 1, 0)" in str(caught.value)


def test_a_field_on_another_grid_is_a_new_one() -> None:
    loss = tk.TopologyLoss(genus=0)
    loss(TORUS, keys="it")
    other = torus(grid(16), 0.5, 0.25)
    assert loss(other, keys="it") == tk.topology_loss(other, 0)
