"""Curves over levels block by block are those in memory, to the last integer."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from typer.testing import CliRunner

import topokit as tk
from topokit.cli.app import app
from topokit.core.blocks.curve import EulerCurve, euler_curve
from topokit.core.blocks.curve_parts import CurvePart, count_curve_part, join_curve_parts
from topokit.core.blocks.division import Box, Division
from topokit.core.blocks.gray_levels import GrayLevels
from topokit.errors import InputError


def assert_same(one: EulerCurve, other: EulerCurve) -> None:
    for name in ("levels", "euler", "betti", "lowest"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def counted(field: NDArray, connectivity: int, division: Division, levels: GrayLevels) -> EulerCurve:
    def count(box: Box) -> CurvePart:
        ranks = levels.ranks(field[tuple(slice(*side) for side in box)])
        return count_curve_part(ranks, box, field.shape, connectivity, levels.n_ranks)

    part = division.reduce(count, partial(join_curve_parts, connectivity))
    assert [len(part.ranks), *map(len, part.links)] == [0, 0, 0]
    return levels.curve(part.tally.curve())


def random_cuts(random: np.random.Generator, n: int) -> tuple[int, ...]:
    return tuple(sorted({0, n, *random.integers(0, n + 1, random.integers(0, 4)).tolist()}))


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("kind", ["bool", "u1", "i2", "f4"])
def test_any_blocks_give_the_curve_in_memory(connectivity: int, kind: str) -> None:
    random = np.random.default_rng(0)
    for number in range(12):
        x, y, z = random.integers(1, 11, 3).tolist()
        smooth = gaussian_filter(random.normal(size=(x, y, z)), 0.4 * (number % 3))
        field = smooth > 0 if kind == "bool" else np.rint(smooth * 40 + 120) if kind == "u1" else smooth * 1000
        field = field.astype(kind)
        if kind == "f4":
            field[random.random(field.shape) < 0.02] = [np.nan, np.inf, -np.inf][number % 3]
        division = Division((random_cuts(random, x), random_cuts(random, y), random_cuts(random, z)))
        levels, whole = GrayLevels.all_of(field.dtype), euler_curve(field, connectivity)
        if levels is None:
            given = np.sort(random.normal(size=9)) * 1000
            levels, whole = GrayLevels.at(given), whole.at(given)
        assert_same(counted(field, connectivity, division, levels), whole)


def test_a_ring_and_a_shell_are_found_across_blocks() -> None:
    ring, shell = np.ones((7, 7, 3), np.uint8), np.full((7, 7, 7), 2, np.uint8)
    ring[2:5, 2:5] = 0
    shell[2:5, 2:5, 2:5] = 1
    for field, betti in ((ring, [[1, 1, 0], [0, 0, 0]]), (shell, [[1, 0, 0], [1, 0, 1], [0, 0, 0]])):
        shape = tk.from_voxels(field, level=0, block_voxels=8)
        assert shape.euler_curve(range(len(betti))).betti.tolist() == betti
        assert_same(shape.euler_curve(), euler_curve(field))


def test_floats_need_levels() -> None:
    field = gaussian_filter(np.random.default_rng(1).normal(size=(9, 8, 10)), 1).astype(np.float32)
    whole, blocks = tk.from_voxels(field, level=0.0), tk.from_voxels(field, level=0.0, block_voxels=100)
    with pytest.raises(InputError, match="float32"):
        blocks.euler_curve()
    with pytest.raises(InputError, match="ascending"):
        blocks.euler_curve([1, 1])
    with pytest.raises(InputError, match="positive"):
        blocks.euler_curve(0)
    found = blocks.euler_curve(5)
    np.testing.assert_allclose(found.levels, np.linspace(field.min(), field.max(), 5))
    assert_same(found, whole.euler_curve(found.levels))
    with pytest.raises(InputError, match="no finite"):
        tk.from_voxels(np.full((4, 4, 4), np.nan), level=0.0, block_voxels=20).euler_curve(5)


def test_labels_and_few_levels() -> None:
    field = np.random.default_rng(2).integers(0, 5, (6, 7, 5))
    whole, blocks = tk.from_voxels(field, label=(1, 3)), tk.from_voxels(field, label=(1, 3), block_voxels=40)
    assert_same(blocks.euler_curve([0]), whole.euler_curve([0]))
    gray = tk.from_voxels(field.astype(np.uint16), level=0, block_voxels=40)
    assert gray.euler_curve(2).levels.tolist() == [gray.euler_curve().levels[0], 4]


def test_the_command_counts_floats_of_a_zarr_volume(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr", reason="zarr is not installed; make test installs it")
    field = gaussian_filter(np.random.default_rng(3).normal(size=(12, 11, 10)), 1).astype(np.float32)
    stored = zarr.create_array(tmp_path / "field.zarr", shape=field.shape, chunks=(5, 4, 6), dtype=field.dtype)
    stored[:] = field
    wanted = ["curve", str(tmp_path / "field.zarr"), "--levels", "7", "--json"]
    told = json.loads(CliRunner().invoke(app, [*wanted, "--block-voxels", "200"]).stdout)
    levels = np.linspace(field.min(), field.max(), 7)
    np.testing.assert_allclose(told["levels"], levels)
    assert told["betti"] == euler_curve(field).at(told["levels"]).betti.tolist()
