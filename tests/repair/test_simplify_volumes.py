"""`Shape.simplify` of volumes: what is narrower than a width goes, by few voxels, and all else stays."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

import topokit as tk
from topokit.errors import InputError

N = 28
X, Y, Z = np.meshgrid(*[np.arange(N)] * 3, indexing="ij")


def ball(x: float, y: float, z: float, radius: float) -> np.ndarray:
    return (X - x) ** 2 + (Y - y) ** 2 + (Z - z) ** 2 <= radius**2


BODY = ball(14, 14, 14, 9)
PLATE = (abs(X - 14) <= 2) & (Y > 2) & (Y < 25) & (Z > 2) & (Z < 25)
RING = (abs(np.hypot(X - 14, Y - 14) - 8) <= 2) & (abs(Z - 14) <= 2)  # its tunnel is 11 wide
CASES = {  # a volume, the most voxels that mend it, its truth
    "a speck": (BODY | ball(2, 2, 2, 1), 7, (1, 0, 0)),
    "a bubble": (BODY & ~ball(14, 16, 14, 1), 7, (1, 0, 0)),
    "a hole through a plate": (PLATE & ~((abs(Y - 10) < 2) & (abs(Z - 12) < 2)), 9, (1, 0, 0)),
    "a thin handle": (BODY | ((X == 14) & (Y == 25) & (abs(Z - 14) < 6)) | ((X == 14) & (Y > 14)
                      & (Y < 26) & (abs(abs(Z - 14) - 6) == 0)), 2, (1, 0, 0)),
    "a broken ring with a gap of two": (ball(14, 14, 5, 4) | ball(14, 14, 16, 5), 2, (1, 0, 0)),
    "a sealed bubble under a thin wall": (BODY & ~ball(14, 18, 14, 3), 4, (1, 0, 0)),
    "a ring, which stays": (RING | ball(2, 2, 2, 1), 7, (1, 1, 0)),
}  # fmt: skip


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("case", CASES)
def test_narrow_features_go_by_few_voxels(case: str, connectivity: int) -> None:
    volume, most, betti = CASES[case]
    shape = tk.from_voxels(volume, connectivity=connectivity)
    mended = shape.simplify(below=4)
    done = mended.simplification
    after = mended.field.volume.numpy()
    assert mended.betti().solid == betti == done.after
    assert done.before == shape.betti().solid != betti
    assert 0 < done.changed == (after != volume).sum() <= most
    assert done.removals
    assert sum(one.changed for one in done.removals) >= done.changed
    assert mended.simplify(below=4).simplification.changed == 0


def test_what_is_left_is_what_is_counted_above_the_width() -> None:
    noise = gaussian_filter(np.random.default_rng(0).normal(size=(24, 24, 24)), 1.8)
    shape = tk.from_voxels(noise / noise.std(), level=0.0)
    features = shape.features(above=2.0)
    assert len(features.features) > 5
    for width in (3.0, 4.0, 5.0):
        found = np.array(shape.simplify(below=width).betti().solid)
        # grids shift widths by part of a voxel, so that one feature may be on the other side
        assert np.abs(found - features.above(width)).sum() <= 1, width


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("seed", range(3))
def test_noise_has_exactly_the_removed_features_less(seed: int, connectivity: int) -> None:
    volume = gaussian_filter(np.random.default_rng(seed).normal(size=(15, 14, 13)), 0.8) > 0.1
    shape = tk.from_voxels(volume, connectivity=connectivity, spacing=(1, 1, 1.5))
    done = shape.simplify(below=2.5, components=False).simplification
    kinds = [one.kind for one in done.removals]
    assert len(kinds) > 5
    for kind, before, after in zip(("part", "tunnel", "cavity"), done.before, done.after, strict=True):
        assert before - after == kinds.count(kind)


@pytest.mark.parametrize(
    ("handles", "how", "voxels"), [("cut", "cut", 24), ("fill", "filled", 9), ("auto", "filled", 9)]
)
def test_tunnels_are_cut_or_filled_as_asked(handles: str, how: str, voxels: int) -> None:
    frame = np.zeros((24, 24, 10), dtype=bool)
    frame[2:22, 2:22, 2:8] = True
    frame[5:8, 9:12] = False  # a tunnel of 3 x 3, the handle beside it 3 x 6
    done = tk.from_voxels(frame).simplify(below=4, handles=handles).simplification
    assert [(one.kind, one.how) for one in done.removals] == [("tunnel", how)]
    assert done.changed <= voxels
    assert done.removals[0].width == pytest.approx(3, abs=0.2)
    kept = tk.from_voxels(frame).simplify(below=4, handles=False)
    assert kept.genus() == 1
    assert kept.simplification.changed == 0


def test_wide_tunnels_are_filled_where_wide_is_asked_for() -> None:
    shape = tk.from_voxels(RING)
    assert shape.simplify(below=9, handles="fill", components=False).genus() == 1
    assert shape.simplify(below=15, handles="fill", components=False).genus() == 0


def test_kinds_that_are_to_stay_stay() -> None:
    volume = (BODY & ~ball(14, 14, 14, 1)) | ball(2, 2, 2, 1)
    shape = tk.from_voxels(volume)
    assert shape.simplify(below=4, cavities=False).betti().solid == (1, 0, 1)
    assert shape.simplify(below=4, components=False).betti().solid == (2, 0, 0)


def test_scores_decide_where_a_gap_is_bridged() -> None:
    scores = np.full((26, 15, 15), 0.05, dtype=np.float32)
    scores[2:24, 4:11, 4:11] = 0.9
    scores[12:14] = 0.05
    scores[12:14, 9, 9] = 0.45  # the network nearly saw the vessel here
    mended = tk.from_voxels(scores, level=0.5).simplify(below=3)
    changed = np.argwhere(mended.field.volume.numpy() != scores)
    assert mended.betti().solid == (1, 0, 0)
    assert changed.tolist() == [[12, 9, 9], [13, 9, 9]]
    assert mended.field.volume.dtype == torch.float32


def test_labels_take_the_value_beside_and_other_labels_stay() -> None:
    labels = np.zeros((24, 24, 24), dtype=np.int16)
    labels[4:20, 4:20, 4:20] = 3
    labels[12:, 4:20, 4:20] = 5
    labels[8, 8, 8] = 5  # a bubble in label 3
    mended = tk.from_voxels(labels, label=3, spacing=(1, 1, 2), origin=(5, 6, 7)).simplify(below=3)
    after = mended.field.volume.numpy()
    assert after.dtype == labels.dtype
    assert after[8, 8, 8] == 3
    assert (after != labels).sum() == 1
    assert mended.field.grid.spacing == (1, 1, 2)
    assert mended.field.grid.origin == (5, 6, 7)
    assert mended.simplification.removals[0].place == (13, 14, 23)
    [text] = [note for note in mended.report().reasons if "Simplified" in note]
    assert "1 voxel changed" in text


def test_a_function_becomes_the_volume_of_its_values() -> None:
    def two_balls(p: torch.Tensor) -> torch.Tensor:
        big, small = p.norm(dim=1) - 0.6, (p - torch.tensor([0.8, 0.8, 0.8])).norm(dim=1) - 0.1
        return torch.minimum(big, small)

    shape = tk.from_sdf(two_balls, bounds=(-1, 1), resolution=128, field_resolution=32)
    mended = shape.simplify(below=0.4)
    assert (shape.n_components, mended.n_components) == (2, 1)
    assert mended.simplification.unit == "voxel"


def test_what_is_asked_is_checked() -> None:
    shape = tk.from_voxels(BODY)
    with pytest.raises(InputError, match="positive width"):
        shape.simplify(below=0)
    with pytest.raises(InputError, match="'auto', 'cut', 'fill' or False"):
        shape.simplify(below=1, handles="remove")
    with pytest.raises(InputError, match="every part is narrower"):
        shape.simplify(below=30)
    with pytest.raises(InputError, match="cut out of a larger body"):
        tk.from_voxels(BODY, edges="cut-out").simplify(below=2)
    with pytest.raises(InputError, match="periodic"):
        tk.from_voxels(BODY, periodic=True).simplify(below=2)


def test_the_table_is_text_and_plain_values() -> None:
    done = tk.from_voxels(CASES["a bubble"][0]).simplify(below=4).simplification
    assert done.text().splitlines()[0] == (
        "Simplified below 4: 1 piece, 0 tunnels, 0 cavities (before: 1, 0, 1), 7 voxels changed."
    )
    assert "cavity  filled" in done.text()
    assert done.to_dict()["removals"][0]["how"] == "filled"


def test_widths_are_those_of_the_solid_as_it_is_by_then() -> None:
    x, y, z = np.meshgrid(*[np.arange(44) - 21.5] * 3, indexing="ij")
    ring = np.hypot(np.hypot(x, y) - 15, z) <= 5
    bubble = (x + 2) ** 2 + (y + 15) ** 2 + z**2 <= 6.3  # the walls beside it are thin as long as it is there
    mended = tk.from_voxels(ring & ~bubble).simplify(below=7.5)
    assert np.array_equal(mended.field.volume.numpy(), ring)


def test_changes_that_remove_nothing_are_not_made() -> None:
    noise = gaussian_filter(np.random.default_rng(1).normal(size=(22, 22, 22)), 0.8)
    shape = tk.from_voxels(noise, level=0.0, spacing=(1, 1, 1.5))
    done = shape.simplify(below=5, components=False).simplification  # two such changes would undo each other for ever
    kinds = [one.kind for one in done.removals]
    assert [before - after for before, after in zip(done.before, done.after, strict=True)] == [
        kinds.count(kind) for kind in ("part", "tunnel", "cavity")
    ]


def test_where_nothing_is_narrow_the_summary_says_so() -> None:
    done = tk.from_voxels(CASES["a ring, which stays"][0]).simplify(below=0.5).simplification
    assert (done.removals, done.changed) == ((), 0)
    assert "Nothing below 0.5" in done.text()
    assert done.before == done.after == (2, 1, 0)


def test_the_order_of_axes_in_memory_does_not_matter() -> None:
    noise = gaussian_filter(np.random.default_rng(5).normal(size=(40, 36, 32)), 1.5)
    volume = noise > 0.5 * noise.std()
    one, other = (tk.from_voxels(made(volume)).simplify(below=3) for made in (np.ascontiguousarray, np.asfortranarray))
    assert one.simplification == other.simplification
    assert torch.equal(one.field.volume, other.field.volume)


def test_what_is_narrowest_is_said_where_nothing_is_narrower() -> None:
    plate = (abs(X - 14) <= 3) & ~((abs(Y - 14) < 2) & (abs(Z - 14) < 2))  # a hole three wide
    done = tk.from_voxels(plate).simplify(below=2.5).simplification
    assert done.removals == ()
    assert 2.5 <= done.narrowest <= 3.1
    assert "The narrowest that was seen" in done.summary()
    assert tk.from_voxels(BODY).simplify(below=2.5).simplification.narrowest is None


def test_a_width_may_be_any_real_number_and_ways_are_checked() -> None:
    plate = np.zeros((20, 20, 7), dtype=bool)
    plate[2:18, 2:18, 2:5] = True
    plate[9:11, 9:11] = False
    shape = tk.from_voxels(plate)
    for width in (3, 3.0, np.float32(3), np.int64(3)):
        assert shape.simplify(below=width).genus() == 0
    for wrong in (True, "3", 0, np.nan, np.inf):
        with pytest.raises(tk.InputError, match="a positive width"):
            shape.simplify(below=wrong)
    for wrong in ("open", ["cut"], 0):
        with pytest.raises(tk.InputError, match="handles is"):
            shape.simplify(below=3, handles=wrong)
