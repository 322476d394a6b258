"""Boxes whose ends are no ends: Betti numbers on the torus as gudhi finds them, and contributions that add up."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy import cos, sin
from typer.testing import CliRunner

import topokit as tk
from topokit.cli.app import app
from topokit.core.blocks.periodic import count_periodic
from topokit.core.grid.minkowski import cube_counts, minkowski_numbers
from topokit.errors import InputError, NoSamplesError

SURFACES = {  # level sets of period 2π; how many primitive cells of genus 3 are in the cube
    "P": (lambda x, y, z: cos(x) + cos(y) + cos(z), 1),
    "G": (lambda x, y, z: sin(x) * cos(y) + sin(y) * cos(z) + sin(z) * cos(x), 2),
    "D": (lambda x, y, z: cos(x) * cos(y) * cos(z) - sin(x) * sin(y) * sin(z), 4),
}


def cells(name: str, n_voxels: int, n_cells: int) -> np.ndarray:
    axis = (np.arange(n_cells * n_voxels) + 0.5) * 2 * np.pi / n_voxels
    return SURFACES[name][0](*np.meshgrid(axis, axis, axis, indexing="ij")) > 0.011


@pytest.mark.parametrize("connectivity", [6, 26])
def test_betti_numbers_on_the_torus_are_those_of_gudhi(connectivity: int) -> None:
    gudhi = pytest.importorskip("gudhi", reason="gudhi is not installed; make test installs it")
    random = np.random.default_rng(0)
    cells = "vertices" if connectivity == 6 else "top_dimensional_cells"
    for _ in range(100):
        inside = random.random(random.integers(3, 7, 3)) < random.choice((0.2, 0.5, 0.8, 0.95))
        periodic = tuple(bool(axis) for axis in random.integers(0, 2, 3))
        padded = np.pad(np.where(inside, -1.0, 1.0), [(0 if axis else 1,) * 2 for axis in periodic], constant_values=1)
        complex_ = gudhi.PeriodicCubicalComplex(**{cells: padded}, periodic_dimensions=list(periodic))
        complex_.compute_persistence(min_persistence=-1)
        found = count_periodic(inside, connectivity, periodic)
        betti = tuple(complex_.persistent_betti_numbers(0, 0))
        assert found.betti == betti[:3]
        assert found.euler == betti[0] - betti[1] + betti[2] - betti[3]


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("name", SURFACES)
def test_minimal_surfaces_have_genus_three_in_each_primitive_cell(name: str, connectivity: int) -> None:
    n_primitive = SURFACES[name][1]
    for n_cells in (1, 2, 3):
        found = count_periodic(cells(name, 16, n_cells), connectivity, (True, True, True))
        assert 2 * found.euler == -4 * n_primitive * n_cells**3  # χ of a surface of genus 3 is −4
        assert (found.betti[0], found.betti[2], found.n_surfaces) == (1, 0, 1)


def test_slabs_bars_and_full_boxes_wind_around() -> None:
    slab, bar = np.zeros((2, 4, 4, 4), bool)
    slab[1], bar[1, 1] = True, True
    for inside, betti, n_surfaces in ((slab, (1, 2, 1), 2), (bar, (1, 1, 0), 1), (~bar, (1, 3, 2), 1)):
        found = count_periodic(inside, 26, (True, True, True))
        assert (found.betti, found.euler, found.n_surfaces) == (betti, 1 - betti[1] + betti[2], n_surfaces)
    full = count_periodic(np.ones((3, 3, 3), bool), 26, (True, True, True))
    assert (full.betti, full.euler, full.n_surfaces) == ((1, 3, 3), 0, 0)
    assert count_periodic(slab, 26, (False, True, True)).n_surfaces == 2
    assert count_periodic(~slab, 26, (False, False, False)).betti == (2, 0, 0)


@pytest.mark.parametrize("connectivity", [6, 26])
def test_contributions_of_blocks_add_up_to_the_whole(connectivity: int) -> None:
    random = np.random.default_rng(1)
    for share in (0.1, 0.3, 0.6):
        whole = random.random((25, 25, 25)) < share
        for n_blocks in (2, 3):
            side = 24 // n_blocks
            starts = product(range(0, 24, side), repeat=3)
            blocks = (whole[tuple(slice(start, start + side + 1) for start in place)] for place in starts)
            total, parts = numbers(whole, connectivity), [numbers(block, connectivity) for block in blocks]
            assert sum(part.euler for part in parts) == total.euler
            for name in ("volume", "surface_area", "mean_breadth"):
                assert sum(getattr(part, name) for part in parts) == pytest.approx(getattr(total, name))


def numbers(inside: np.ndarray, connectivity: int):
    return minkowski_numbers(cube_counts(inside), connectivity, (1.0, 2.0, 3.0))


def same(one: tk.TopologyReport, other: tk.TopologyReport) -> bool:
    names = ("solid_betti", "solid_euler", "euler", "cut_out_euler", "connectivity_density", "minkowski", "genus")
    return all(getattr(one, name) == getattr(other, name) for name in names)


@pytest.mark.parametrize("connectivity", [6, 26])
def test_blocks_of_periodic_and_cut_out_volumes_are_counted_as_the_whole(connectivity: int) -> None:
    random = np.random.default_rng(2)
    ends = [{"periodic": axes} for axes in product((False, True), repeat=3)] + [{"edges": "cut-out"}]
    for share, most in product((0.1, 0.4, 0.7, 1.0), (1, 8, 30, 1000)):
        shape = random.integers(2 if most > 1 else 1, 8, 3)
        inside = random.random(shape) < share
        inside[0, 0, 0] = True
        for options in ends[: None if min(shape) > 1 else 8]:
            given = {"connectivity": connectivity, "spacing": (1.0, 2.0, 3.0), **options}
            whole = tk.from_voxels(inside, **given).report()
            assert same(tk.from_voxels(inside, block_voxels=most, **given).report(), whole), (shape, share, options)


def test_stored_periodic_volumes_are_read_around_their_ends(tmp_path: Path) -> None:
    da = pytest.importorskip("dask.array", reason="dask is not installed; make test installs it")
    zarr = pytest.importorskip("zarr", reason="zarr is not installed; make test installs it")
    inside = np.random.default_rng(3).random((20, 15, 11)) < 0.5
    stored = zarr.create_array(tmp_path / "a.zarr", data=inside, chunks=(8, 8, 8))
    np.save(tmp_path / "a.npy", inside)
    for options in ({"periodic": (True, False, True)}, {"periodic": True}, {"edges": "cut-out"}):
        whole = tk.from_voxels(inside, **options).report()
        for volume in (stored, da.from_array(inside, chunks=(7, 6, 5)), np.load(tmp_path / "a.npy", mmap_mode="r")):
            shape = tk.from_voxels(volume, block_voxels=600, **options)
            assert same(shape.report(), whole)
            with pytest.raises(NoSamplesError):
                _ = shape.samples
    labels = np.where(inside, 5, 3)
    notes = tk.from_voxels(labels, label=(5, 9), periodic=True, block_voxels=600).report().reasons
    assert "No voxel has the label 9." in notes


def test_reports_speak_of_the_torus_and_of_the_larger_body() -> None:
    lattice = cells("P", 16, 1)
    shape = tk.from_voxels(lattice, periodic=True)
    report = shape.report()
    assert (shape.genus(), report.components, report.solid_betti, report.solid_euler) == (3, 1, (1, 3, 0), -2)
    assert str(report).startswith(
        "voxels: 1 piece, 3 tunnels, 0 cavities (χ of the solid -2, of its surface -4), certain"
    )
    with pytest.raises(NoSamplesError, match="periodic"):
        _ = shape.samples
    assert tk.from_voxels(lattice, periodic=(False, True, False)).report().euler % 2 == 0
    twice = np.pad(np.tile(lattice, (2, 2, 2)), [(0, 1)] * 3, mode="wrap")
    report = tk.from_voxels(twice, edges="cut-out", spacing=0.5).report()
    assert report.cut_out_euler == -2 * 8
    assert report.connectivity_density == (1 + 16) / 16**3
    assert "cut from a larger body" in str(report)
    assert report.minkowski == tk.from_voxels(twice, edges="cut-out", spacing=0.5).minkowski()
    cell = tk.from_voxels(lattice, periodic=True, spacing=0.5).minkowski()  # of one period, which is there 8 times
    assert report.minkowski.surface_area == pytest.approx(8 * cell.surface_area)
    assert report.minkowski.volume == 8 * cell.volume == twice[1:, 1:, 1:].sum() / 8
    assert cell.euler == -2


def test_boxes_that_are_none_are_refused() -> None:
    inside = np.ones((4, 4, 4), bool)
    wrong = ({"periodic": (True, True)}, {"edges": "open"}, {"periodic": True, "edges": "cut-out"})
    for options in wrong:
        with pytest.raises(InputError):
            tk.from_voxels(inside, **options)
    with pytest.raises(InputError, match="two layers"):
        tk.from_voxels(inside[:1], edges="cut-out").report()


def test_the_shell_takes_boxes(tmp_path: object) -> None:
    np.save(f"{tmp_path}/p.npy", cells("P", 16, 1))
    found = CliRunner().invoke(app, ["report", f"{tmp_path}/p.npy", "--periodic", "true"])
    assert "3 tunnels" in found.stdout, found.stderr
    found = CliRunner().invoke(app, ["report", f"{tmp_path}/p.npy", "--edges", "cut-out"])
    assert "larger body" in found.stdout, found.stderr
