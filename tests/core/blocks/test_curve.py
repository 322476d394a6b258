"""χ and Betti numbers over all levels: those of cubical persistence, and of a count at every single level."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from typer.testing import CliRunner

import topokit as tk
from topokit.cli.app import app
from topokit.core.blocks.curve import euler_curve
from topokit.core.cloud.solid.union_curve import union_curve
from topokit.core.grid.betti import betti_numbers
from topokit.core.grid.euler import solid_euler
from topokit.errors import InputError


def persistent_betti(field: np.ndarray, connectivity: int, levels: np.ndarray) -> np.ndarray:
    """Betti numbers by GUDHI: cells enter with their lowest voxel (6) or their highest one (26)."""
    gudhi = pytest.importorskip("gudhi", reason="gudhi is not installed; make test installs it")
    cells = {"vertices" if connectivity == 6 else "top_dimensional_cells": -field.astype(float)}
    complex_ = gudhi.CubicalComplex(**cells)
    complex_.compute_persistence(homology_coeff_field=2, min_persistence=-1)
    betti = np.zeros((len(levels), 3), dtype=int)
    for dimension in range(3):
        pairs = -complex_.persistence_intervals_in_dimension(dimension).reshape(-1, 2)
        for row, level in enumerate(levels):
            betti[row, dimension] = ((pairs[:, 0] > level) & (pairs[:, 1] <= level)).sum()
    return betti


def all_levels(field: np.ndarray) -> np.ndarray:
    levels = np.unique(field).astype(float)
    return np.append(levels[0] - 1, levels)


@pytest.mark.parametrize("connectivity", [6, 26])
def test_curves_are_those_of_cubical_persistence(connectivity: int) -> None:
    random = np.random.default_rng(0)
    for number in range(80):
        shape = tuple(random.integers(1, 8, 3))
        field = random.integers(0, 6, shape) if number % 2 else random.normal(size=shape)
        levels = all_levels(field)
        curve = euler_curve(field, connectivity).at(levels)
        betti = persistent_betti(field, connectivity, levels)
        np.testing.assert_array_equal(curve.betti, betti)
        np.testing.assert_array_equal(curve.euler, betti @ (1, -1, 1))


@pytest.mark.parametrize("connectivity", [6, 26])
def test_the_curve_of_euler_characteristics_alone_is_the_same(connectivity: int) -> None:
    random = np.random.default_rng(2)
    for number in range(20):
        field = random.integers(0, 9, (6, 7, 8)) if number % 2 else random.normal(size=(6, 7, 8)).astype("f4")
        levels = all_levels(field)
        shape = tk.from_voxels(field, level=0, connectivity=connectivity)
        whole, alone = shape.euler_curve(), shape.euler_curve(betti=False)
        assert alone.at(levels).euler.tolist() == whole.at(levels).euler.tolist()
        assert (alone.betti.shape, alone.lowest.tolist()) == ((len(alone.levels), 0), [whole.lowest[0]])
        assert shape.euler_curve(5, betti=False).to_dict()["betti"] == [[]] * 5
        blocks = tk.from_voxels(field, level=0, connectivity=connectivity, block_voxels=40)
        found = blocks.euler_curve(levels, betti=False)
        assert (found.levels.tolist(), found.euler.tolist()) == (levels.tolist(), whole.at(levels).euler.tolist())


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("kind", [bool, "u1", "i1", ">i2", "u2", "i4", "u4", "u8", "f2", "f4", "f8"])
def test_every_type_of_values_is_counted_at_every_level(connectivity: int, kind: str) -> None:
    smooth = gaussian_filter(np.random.default_rng(1).normal(size=(9, 8, 10)), 1)
    field = np.rint((smooth - smooth.min()) * 40).astype(kind)
    levels = all_levels(field.astype(float))
    curve = euler_curve(field, connectivity).at(levels)
    for level, euler, betti in zip(levels, curve.euler, curve.betti, strict=True):
        assert euler == solid_euler(field.astype(float), level, connectivity)
        assert betti.tolist() == betti_numbers(field.astype(float), level, connectivity).tolist()


def test_nan_and_infinities_have_a_place() -> None:
    field = np.array([[[np.inf, 1, np.nan, 2, -np.inf, 3]]])
    curve = euler_curve(field)
    assert curve.levels.tolist() == [2, 3, np.inf]  # 1 joins a piece that is there
    assert curve.lowest.tolist() == [3, 3, 0, 0]  # all that is neither NaN nor −∞
    assert curve.betti[:, 0].tolist() == [2, 1, 0]
    assert curve.range_of(2.5) == (2, 3)
    assert curve.range_of(0) == (-np.inf, 2)


def test_what_is_no_field_or_level_is_refused() -> None:
    with pytest.raises(InputError, match="2³¹"):
        euler_curve(np.zeros((3, 3)))
    with pytest.raises(InputError, match="complex"):
        euler_curve(np.zeros((3, 3, 3), complex))
    with pytest.raises(InputError, match="uint64"):
        euler_curve(np.full((3, 3, 3), 2**64 - 1, np.uint64))
    with pytest.raises(InputError, match="ascending"):
        euler_curve(np.zeros((3, 3, 3))).at([1, 1])


def test_shapes_with_a_field_have_curves() -> None:
    gray = gaussian_filter(np.random.default_rng(2).normal(size=(12, 12, 12)), 1).astype(np.float32)
    shape = tk.from_voxels(torch.from_numpy(gray), level=0.05, connectivity=6, n_samples=100)
    report = shape.report(details=True)
    curve = shape.euler_curve([-0.05, 0.05])
    assert tuple(curve.betti[1]) == report.solid_betti
    low, high = report.level_range
    assert low <= 0.05 < high
    for level, same in ((low, True), (np.nextafter(low, -1), False), (np.nextafter(high, -1), True), (high, False)):
        betti = betti_numbers(gray.astype(float), float(level), 6).tolist()
        assert (tuple(betti) == report.solid_betti) == same
    labels = np.arange(27).reshape(3, 3, 3) % 2 + 3
    assert tk.from_voxels(labels, label=4, connectivity=6).euler_curve([0]).betti.tolist() == [[13, 0, 0]]
    assert tk.from_voxels(labels, label=4, n_samples=100).report(details=True).level_range is None
    options = {"bounds": ((-1, -1, -1), (1, 1, 1)), "field_resolution": 16}
    sphere = tk.from_sdf(lambda x: x.norm(dim=-1) - 0.5, **options)
    assert sphere.euler_curve([0.0, 0.4]).betti.tolist() == [[1, 0, 0]] * 2  # 0.4 inside the surface


def test_a_mesh_has_a_curve_over_the_distance() -> None:
    torus = tk.from_mesh(*tk.testing.torus_mesh(major=1.0, minor=0.4))
    curve = torus.euler_curve([-0.8, -0.4, -0.2, 0.0, 0.3, 0.5], resolution=64)
    assert curve.betti.tolist() == [[1, 0, 0], [1, 1, 0], [1, 1, 0], [1, 1, 0], [1, 1, 0], [0, 0, 0]]
    assert "distance" in curve.over
    with pytest.raises(InputError, match="resolution"):
        torus.euler_curve(resolution=0)
    vertices, faces = tk.testing.icosphere(1)
    with pytest.raises(InputError, match="no closed surface"):
        tk.from_mesh(vertices, faces[1:]).euler_curve()


def test_points_have_a_curve_over_the_radius(tmp_path: Path) -> None:
    points = tk.testing.torus_mesh(major=1.0, minor=0.4)[0]
    curve = tk.from_points(points).euler_curve([0.0, 0.2, 0.5])
    assert curve.betti.tolist() == [[len(points), 0, 0], [1, 2, 1], [1, 1, 0]]
    with pytest.raises(InputError, match="4 distinct points"):
        union_curve(np.repeat(np.eye(4, 3), 3, axis=0))
    np.savetxt(tmp_path / "cloud.xyz", points)
    found = CliRunner().invoke(app, ["curve", str(tmp_path / "cloud.xyz"), "--json"])
    assert json.loads(found.stdout)["over"] == curve.over
    assert json.loads(found.stdout)["betti"][-1] == [1, 0, 0]


def test_the_command_needs_no_level_and_draws(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib is not installed; make test installs it")
    ring = np.full((3, 3, 1), 9, np.int16)
    ring[1, 1] = 4
    np.save(tmp_path / "ring.npy", ring)
    plot = tmp_path / "plot.svg"
    found = CliRunner().invoke(app, ["curve", str(tmp_path / "ring.npy"), "-o", str(plot)])
    assert found.stdout.splitlines() == ["level\teuler\tpieces\ttunnels\tcavities", "4\t0\t1\t1\t0", "9\t0\t0\t0\t0"]
    assert "<svg" in plot.read_text()
    found = CliRunner().invoke(app, ["curve", str(tmp_path / "ring.npy"), "--json", "--levels", "0"])
    assert '"betti"' in found.stdout
    wrong = CliRunner().invoke(app, ["curve", str(tmp_path / "ring.npy"), "-o", str(tmp_path / "plot.gif")])
    assert wrong.exit_code == 1
