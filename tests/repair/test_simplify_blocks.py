"""`Shape.simplify` of volumes in files, block by block: as in memory where a block shows what a place is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import topokit as tk
from topokit.core.grid.betti import betti_numbers
from topokit.errors import InputError

LONG = (240, 30, 30)
X, Y, Z = np.meshgrid(*map(np.arange, LONG), indexing="ij")
TWO_BLOCKS = LONG[0] * LONG[1] * LONG[2] // 2
BAR = (X > 4) & (X < 235) & (abs(Y - 12) < 7) & (abs(Z - 12) < 7)


def ball(x: int, y: int, z: int, radius: float) -> np.ndarray:
    return (X - x) ** 2 + (Y - y) ** 2 + (Z - z) ** 2 <= radius**2


def in_blocks(folder: Path, volume: np.ndarray, voxels: int = TWO_BLOCKS, **options: object) -> tk.Shape:
    np.save(folder / "volume.npy", volume)
    return tk.from_voxels(folder / "volume.npy", block_voxels=voxels, **options)


def told(one: tk.Removal) -> tuple[object, ...]:
    return one.kind, one.how, round(one.width, 6), one.changed


FLAWED = (BAR & ~ball(40, 12, 12, 1.5) & ~ball(119, 12, 12, 1.5)) | ball(200, 27, 27, 1)
FLAWED &= ~((abs(X - 80) < 2) & (abs(Y - 12) < 2))  # a hole through the bar
FLAWED &= ~((abs(X - 121) < 1) & (abs(Z - 7) < 1))  # and one at the end of a block


@pytest.mark.parametrize("suffix", ["npy", "zarr"])
@pytest.mark.parametrize("kind", ["binary", "bytes", "labels", "scores"])
def test_away_from_ends_of_blocks_and_across_them_it_is_as_in_memory(tmp_path: Path, kind: str, suffix: str) -> None:
    if suffix == "zarr":
        pytest.importorskip("zarr")
    draw = np.random.default_rng(0)
    values = {
        "binary": FLAWED,
        "bytes": 200 * FLAWED.astype(np.uint8),
        "labels": np.where(FLAWED, 3, 7 * (Y > 12)),
        "scores": np.where(FLAWED, 0.8, 0.3) + 0.1 * draw.random(LONG),
    }[kind]
    options = {"labels": {"label": 3}, "scores": {"level": 0.5}}.get(kind, {})
    wanted = tk.from_voxels(values, **options).simplify(below=4)
    shape = in_blocks(tmp_path, values, **options)
    found = shape.simplify(below=4, out=tmp_path / f"out.{suffix}")
    assert found.report().solid_betti == (1, 0, 0)
    assert (found.simplification.after, found.simplification.before) == ((1, 0, 0), wanted.simplification.before)
    both = [sorted(told(one) for one in made.simplification.removals) for made in (found, wanted)]
    assert both[0] == both[1]
    assert found.simplification.unsettled == ()
    written = tk.load(tmp_path / f"out.{suffix}", **options)
    assert written.field.volume.dtype == wanted.field.volume.dtype
    assert np.array_equal(written.field.volume.numpy(), wanted.field.volume.numpy())


def test_what_no_block_shows_is_left_and_said(tmp_path: Path) -> None:
    wire = (abs(Y - 24) < 1) & (abs(Z - 12) < 1) & (X > 10) & (X < 230)
    ends = ((abs(X - 11) < 1) | (abs(X - 229) < 1)) & (Y >= 12) & (Y < 25) & (abs(Z - 12) < 1)
    volume = BAR | wire | ends  # a thin handle, longer than a block
    assert tk.from_voxels(volume).simplify(below=2).betti().solid == (1, 0, 0)
    left = in_blocks(tmp_path, volume, TWO_BLOCKS // 3).simplify(below=2, out=tmp_path / "out.npy")
    assert left.betti().solid == (1, 1, 0)
    assert left.simplification.removals == ()
    assert {one.kind for one in left.simplification.unsettled} == {"tunnel"}
    for one in left.simplification.unsettled:
        assert volume[tuple(np.rint(one.place).astype(int))]
    assert "not settled in a block" in left.simplification.summary()
    assert "not settled" in left.simplification.text()
    assert np.array_equal(np.load(tmp_path / "out.npy"), volume)


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("seed", range(2))
def test_what_is_done_to_noise_is_what_counting_says(tmp_path: Path, seed: int, connectivity: int) -> None:
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(60, 30, 16)), 1.2)
    volume = noise > (0.3 - 0.5 * seed) * noise.std()
    shape = in_blocks(tmp_path, volume, 30 * 30 * 16, connectivity=connectivity)
    before = betti_numbers(volume.astype(float), 0.5, connectivity).tolist()
    done = shape.simplify(below=2.5, out=tmp_path / "out.npy").simplification
    after = betti_numbers(np.load(tmp_path / "out.npy").astype(float), 0.5, connectivity).tolist()
    assert done.before == tuple(before)
    assert done.after == tuple(after)
    assert sum(after) < sum(before)
    assert done.changed == (np.load(tmp_path / "out.npy") != volume).sum()


@pytest.mark.parametrize("suffix", ["npy", "zarr"])
@pytest.mark.parametrize("error", [KeyboardInterrupt, AssertionError])
def test_an_interrupt_or_a_wrong_count_leaves_no_file(
    tmp_path: Path, suffix: str, error: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    if suffix == "zarr":
        pytest.importorskip("zarr")
    shape = in_blocks(tmp_path, FLAWED)

    def stopped(*_: object) -> None:
        raise error

    monkeypatch.setattr("topokit.repair.in_blocks.counted_simplification", stopped)
    with pytest.raises(error):
        shape.simplify(below=4, out=tmp_path / f"out.{suffix}")
    assert [one.name for one in tmp_path.iterdir()] == ["volume.npy"]


def test_where_the_result_goes_must_be_said(tmp_path: Path) -> None:
    shape = in_blocks(tmp_path, FLAWED[:60], 30**3)
    with pytest.raises(InputError, match="pass out"):
        shape.simplify(below=3)
    with pytest.raises(InputError, match=r"\.npy or \.zarr"):
        shape.simplify(below=3, out=tmp_path / "out.nii")
    with pytest.raises(InputError, match="does not exist"):
        shape.simplify(below=3, out=tmp_path / "none" / "out.npy")
    (tmp_path / "out.zarr").mkdir()
    with pytest.raises(InputError, match="exists"):
        shape.simplify(below=3, out=tmp_path / "out.zarr")
    with pytest.raises(InputError, match="in memory"):
        tk.from_voxels(FLAWED).simplify(below=3, out=tmp_path / "out.npy")
    with pytest.raises(InputError, match="no voxel"):
        shape.simplify(below=100, out=tmp_path / "out.npy")
    assert not (tmp_path / "out.npy").exists()
