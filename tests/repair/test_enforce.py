"""`enforce`: the wanted Betti numbers, exactly, by few voxels, in the type that was given."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import topokit as tk

N = 24
AXIS = np.arange(N)
X, Y, Z = np.meshgrid(AXIS, AXIS, AXIS, indexing="ij")


def ball(x: float, y: float, z: float, radius: float) -> np.ndarray:
    return (X - x) ** 2 + (Y - y) ** 2 + (Z - z) ** 2 <= radius**2


def bar(low: int, high: int, half: int = 2, y: int = 12) -> np.ndarray:
    return (low <= X) & (high > X) & (abs(Y - y) <= half) & (abs(Z - 12) <= half)


def betti(volume: object, **options: object) -> tuple[int, int, int]:
    return tk.from_voxels(volume, **options).betti().solid


FAULTS = {
    "a broken bar": bar(2, 11) | bar(12, 22),
    "a bar with a bubble": bar(2, 22) & ~ball(8, 12, 12, 1),
    "a bar with a speck beside it": bar(2, 22) | ball(12, 19, 12, 1),
    "two bars with a bridge": bar(2, 22, y=7)
    | bar(2, 6, y=12)
    | bar(2, 22, y=17)
    | ((X == 15) & (Z == 12) & (Y > 6) & (Y < 18)),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("connectivity", [6, 26])
def test_faults_are_mended_by_few_voxels(fault: str, connectivity: int) -> None:
    volume = FAULTS[fault]
    assert betti(volume, connectivity=connectivity) != (1, 0, 0)
    mended = tk.enforce(volume, connectivity=connectivity)
    assert betti(mended, connectivity=connectivity) == (1, 0, 0)
    assert 0 < (mended != volume).sum() <= 32  # the speck has 7 voxels, the bridge 9, a cut through a bar 25


def test_only_what_is_allowed_is_changed() -> None:
    volume = FAULTS["a bar with a bubble"]
    added, removed = tk.enforce(volume, change="add"), tk.enforce(volume, change="remove")
    assert (added >= volume).all()
    assert (removed <= volume).all()
    assert betti(added) == betti(removed) == (1, 0, 0)


HINTS = {
    (2, 0, 0): ball(6, 12, 12, 5) | ball(17, 12, 12, 5) | bar(6, 17, half=0),
    (1, 1, 0): (abs(np.hypot(X - 12, Y - 12) - 7) <= 2) & (abs(Z - 12) <= 2) & ~((X > 12) & (abs(Y - 12) < 1)),
    (1, 0, 1): ball(12, 12, 12, 8) & ~ball(12, 12, 12, 5) & ~((X == 12) & (Y == 12) & (Z > 12)),
}
"""A neck that nearly parts, a ring that nearly closes, and a cavity with a pinhole."""


@pytest.mark.parametrize("wanted", HINTS)
def test_other_numbers_of_what_is_nearly_so(wanted: tuple[int, int, int]) -> None:
    pieces, tunnels, cavities = wanted
    assert betti(HINTS[wanted]) != wanted
    assert betti(tk.enforce(HINTS[wanted], pieces=pieces, tunnels=tunnels, cavities=cavities)) == wanted


def test_voxels_of_a_label_take_the_values_of_their_neighbors() -> None:
    labels = np.zeros((N, N, N), dtype=np.int16)
    labels[bar(2, 11) | bar(12, 22)] = 3
    labels[ball(12, 18, 12, 2)] = 5
    mended = tk.enforce(labels, label=3)
    assert mended.dtype == labels.dtype
    assert betti(mended, label=3) == (1, 0, 0)
    assert set(np.unique(mended)) == {0, 3, 5}
    assert (mended[labels == 5] == 5).all()


def test_a_gray_volume_changes_where_it_is_near_its_level() -> None:
    field = 6 - np.sqrt((X - 12.0) ** 2 + (Y - 12.0) ** 2 + (Z - 12.0) ** 2)
    field[12, 12, 12:20] = -0.01  # a thin channel to the middle, hardly outside
    field[12, 12, 10] = -4.0
    volume = torch.from_numpy(field)
    assert betti(volume, level=0.0) != (1, 0, 0)
    mended = tk.enforce(volume, level=0.0)
    assert isinstance(mended, torch.Tensor)
    assert mended.dtype == volume.dtype
    assert betti(mended, level=0.0) == (1, 0, 0)


def test_a_shape_gives_a_shape() -> None:
    shape = tk.from_voxels(FAULTS["a broken bar"], spacing=(1.0, 2.0, 0.5), origin=(3.0, 0.0, 0.0)).replace(name="bar")
    mended = tk.enforce(shape)
    assert (mended.name, mended.betti().solid) == ("bar", (1, 0, 0))
    assert mended.field.grid == shape.field.grid


def test_what_cannot_be_found_is_an_error() -> None:
    with pytest.raises(tk.InputError, match=r"no solid with 900 pieces, 0 tunnels and 0 cavities was found"):
        tk.enforce(ball(12, 12, 12, 8), pieces=900)
    with pytest.raises(tk.InputError, match="at least 0"):
        tk.enforce(ball(12, 12, 12, 8), tunnels=-1)
    with pytest.raises(tk.InputError, match="not made from a volume"):
        tk.enforce(tk.from_points(torch.rand(100, 3)))


def test_a_right_volume_stays_as_it_is() -> None:
    volume = ball(12, 12, 12, 8)
    assert (tk.enforce(volume) == volume).all()


def torus_field(p: torch.Tensor) -> torch.Tensor:
    return torch.hypot(p[:, :2].norm(dim=1) - 0.6, p[:, 2]) - 0.25


def test_a_shape_with_given_betti_numbers_knows_what_changed_and_is_a_goal() -> None:
    volume = FAULTS["a bar with a bubble"]
    before = tk.from_voxels(volume, spacing=0.5)
    after = before.enforce((1, 0, 0), change="add")
    assert after.betti().solid == (1, 0, 0)
    assert after.mesh is None
    assert after.volume > before.volume
    assert any("voxels changed sides" in note for note in after.notes)
    loss = after.goal()
    assert loss.goal is not None
    assert loss.goal.betti == (1, 0, 0)


def test_a_function_becomes_a_volume_and_its_goal_trains_it() -> None:
    ring = tk.from_sdf(torus_field, field_resolution=32, resolution=128)
    ball = ring.enforce((1, 0, 0))
    assert (ring.genus(), ball.genus()) == (1, 0)
    loss = ball.goal(at_most=False)
    assert float(loss(ring)) > 0
    assert float(loss(ball)) == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("betti", [(1, 0), (1, 0, -1), (1.0, 0, 0)])
def test_wrong_numbers_are_refused(betti: tuple[int, ...]) -> None:
    with pytest.raises(tk.InputError, match="expected"):
        tk.from_voxels(FAULTS["a broken bar"]).enforce(betti)
    with pytest.raises(tk.InputError, match="change"):
        tk.from_voxels(FAULTS["a broken bar"]).enforce(change="grow")


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("outside", [np.nan, -np.inf])
def test_values_that_are_not_finite_are_background_and_do_not_spread(outside: float) -> None:
    plate = np.zeros((16, 16, 7), dtype=np.float32)
    plate[2:14, 2:14, 2:5] = 1 + 0.1 * np.random.default_rng(0).random((12, 12, 3))
    plate[5:7, 5:7] = 0.2
    plate[0] = outside
    mended = tk.enforce(plate, level=0.5)
    assert (betti(plate, level=0.5), betti(mended, level=0.5)) == ((1, 1, 0), (1, 0, 0))
    assert np.array_equal(np.isfinite(mended), np.isfinite(plate))
