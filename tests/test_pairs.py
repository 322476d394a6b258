"""`tk.compare` for arrays, files, labels and shapes of any kind."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from scipy.ndimage import gaussian_filter

import topokit as tk
from topokit.pairs.files import matched_files
from topokit.testing import torus_mesh, torus_samples

MATCHINGS = "betti-matching", "invariant"
RING = np.zeros((12, 12, 5), np.uint8)
RING[2:10, 2:10, 1:4] = 1
RING[5:7, 5:7] = 0
CUT = RING.copy()
CUT[5, :5] = 0


def test_arrays_tensors_shapes_and_files_agree(tmp_path) -> None:
    np.save(tmp_path / "truth.npy", RING)
    opened = tk.from_voxels(CUT)
    ways = [(CUT, RING), (torch.tensor(CUT), RING > 0), (CUT * 255, tmp_path / "truth.npy")]
    found = [tk.compare(*pair) for pair in ways] + [opened.compare(tk.from_voxels(RING)), tk.compare(opened, opened)]
    assert {one.missing for one in found[:4]} == {(0, 1, 0)}
    assert found[4].is_same
    assert found[2].names == ("voxels", "truth.npy")
    assert found[0].features[0].kind == "broken loop"


def test_levels_labels_and_what_is_ignored() -> None:
    assert tk.compare(CUT * 0.3, RING * 0.3, level=0.2).missing == (0, 1, 0)
    marked = RING.copy()
    marked[5, :5] = 7
    assert tk.compare(CUT, marked, ignore=7).is_same
    assert tk.compare(CUT, RING, ignore=marked == 7).is_same
    assert tk.compare(CUT * 3, RING * 3, label=3).missing == (0, 1, 0)
    with pytest.raises(tk.InputError, match="pass level="):
        tk.compare(CUT * 0.3, marked)
    with pytest.raises(tk.InputError, match="ignore has shape"):
        tk.compare(CUT, RING, ignore=np.ones((2, 2, 2), bool))


def test_grids_of_volumes_have_to_be_the_same(tmp_path) -> None:
    with pytest.raises(tk.InputError, match="resample"):
        tk.compare(RING, RING[1:])
    nibabel = pytest.importorskip("nibabel")
    for name, step in (("a.nii.gz", 1.0), ("b.nii.gz", 2.0)):
        nibabel.save(nibabel.Nifti1Image(RING, np.diag([step, step, step, 1.0])), tmp_path / name)
    with pytest.raises(tk.InputError, match=r"\(1.0, 1.0, 1.0\).*\(2.0, 2.0, 2.0\).*spacing="):
        tk.compare(tmp_path / "a.nii.gz", tmp_path / "b.nii.gz")
    assert tk.compare(tmp_path / "a.nii.gz", tmp_path / "b.nii.gz", spacing=1).is_same
    assert [source.name for source in matched_files(tmp_path, tmp_path)] == ["a", "b"]


def test_places_are_those_of_the_scanner(tmp_path) -> None:
    nibabel = pytest.importorskip("nibabel", reason="nibabel is not installed; make test installs it")
    affine = np.array([[0.0, -2, 0, 40], [1, 0, 0, -50], [0, 0, 3, 7], [0, 0, 0, 1]])  # a quarter turn, and moved
    truth = np.zeros((12, 11, 10), np.uint8)
    truth[2:9, 2:9, 2:8] = 1
    torn = truth.copy()
    torn[5, 4] = 0  # a hole along the last axis
    for name, volume in (("torn", torn), ("truth", truth)):
        nibabel.save(nibabel.Nifti1Image(volume, affine), tmp_path / f"{name}.nii.gz")
    whole = tk.compare(tmp_path / "torn.nii.gz", tmp_path / "truth.nii.gz")
    [of_label] = tk.compare_labels(tmp_path / "torn.nii.gz", tmp_path / "truth.nii.gz").values()
    shapes = tk.load(tmp_path / "torn.nii.gz").compare(tk.load(tmp_path / "truth.nii.gz"))
    for found in (whole, of_label, shapes):
        [hole] = found.features
        i, j, k = hole.place.voxel
        assert (i, j) == (5, 4)
        assert hole.place.world == pytest.approx((40 - 2 * 4, -50 + 5, 7 + 3 * k), abs=1.6)
        assert "mm RAS" in found.text()
        assert found.to_dict()["features"][0]["place"]["unit"] == "mm"


def test_betti_matching_is_what_the_official_program_counts() -> None:
    generator = np.random.default_rng(3)
    values = generator.random((9, 10, 11))
    truth, predicted = values + 0.25 * generator.random(values.shape) > 0.54, values > 0.45
    found, invariant = (tk.compare(predicted, truth, connectivity=6, matching=how) for how in MATCHINGS)
    assert (invariant.matched, found.matched) == ((6, 51, 0), (6, 53, 0))  # 53: see tests/core/comparison
    assert found.spurious[1] == found.betti_a[1] - 53
    assert [one.kind for one in found.features] == [one.kind for one in invariant.features]
    assert "depend on the position" in found.notes[0]
    shapes = [tk.from_voxels(one) for one in (predicted, truth)]
    assert shapes[0].compare(shapes[1], matching="betti-matching").matched == (6, 53, 0)
    labels = tk.compare_labels(predicted * 4, truth * 4, matching="betti-matching")
    assert labels[4].matched == (6, 53, 0)
    assert labels[4].to_dict(places=False)["matching"] == "betti-matching"
    with pytest.raises(tk.InputError, match="pass connectivity=6"):
        tk.compare(predicted, truth, connectivity=26, matching="betti-matching")
    with pytest.raises(tk.InputError, match="was expected"):
        tk.compare(predicted, truth, matching="hungarian")


def test_a_row_for_each_label() -> None:
    truth, predicted = RING * 1 + np.roll(RING, 1, 2) * 0, CUT.copy()
    truth[0, 0, 0], predicted[11, 11, 4] = 4, 9
    found = tk.compare_labels(predicted, truth)
    assert {label: (one.missing, one.spurious) for label, one in found.items()} == {
        1: ((0, 1, 0), (0, 0, 0)),
        4: ((1, 0, 0), (0, 0, 0)),
        9: ((0, 0, 0), (1, 0, 0)),
    }
    [feature] = found[9].features
    assert feature.center == (11.0, 11.0, 4.0)
    assert tk.compare_labels(truth, truth, [2])[2].is_same


def volumes(shape: tuple[int, int, int] = (40, 36, 30)) -> tuple[np.ndarray, np.ndarray]:
    """Gray values with parts, tunnels and cavities above 0.5."""
    generator = np.random.default_rng(2)
    one, noise = (gaussian_filter(generator.standard_normal(shape), 1.1) for _ in range(2))
    return one / one.std() + 0.5, one / one.std() + 0.6 * noise / noise.std() + 0.5


@pytest.mark.parametrize("connectivity", [6, 26])
def test_blocks_of_stored_volumes_give_the_numbers_of_the_whole(connectivity: int, tmp_path) -> None:
    dask, zarr = (pytest.importorskip(name, reason=f"{name} is not installed") for name in ("dask.array", "zarr"))
    pair = volumes()
    whole = tk.compare(*pair, level=0.5, connectivity=connectivity)
    for name, values in zip("ab", pair, strict=True):
        np.save(tmp_path / f"{name}.npy", values)
        stored = zarr.create_array(tmp_path / f"{name}.zarr", shape=values.shape, dtype="f8", chunks=(16, 9, 30))
        stored[:] = values
    ways = (
        pair,
        [tmp_path / "a.npy", tmp_path / "b.npy"],
        [tmp_path / "a.zarr", tmp_path / "b.zarr"],
        [dask.from_array(values, chunks=(7, 36, 10)) for values in pair],
    )
    for a, b in ways:
        found = tk.compare_blocks(a, b, level=0.5, connectivity=connectivity, block_voxels=5000)
        assert (found.betti_a, found.betti_b) == (whole.betti_a, whole.betti_b)
        assert found.matched == (whole.matched[0], None, whole.matched[2])
        assert found.missing == (whole.missing[0], None, whole.missing[2])
        assert found.spurious == (whole.spurious[0], None, whole.spurious[2])
        assert (found.betti_error, found.dice) == (whole.betti_error, pytest.approx(whole.agreement.dice))
    assert min(whole.matched[:2]) > 0  # for cavities see tests/core/comparison
    assert found.to_dict()["missing"] == [*found.missing]
    assert f"tunnels {whole.betti_a[1]} against {whole.betti_b[1]}, not matched in blocks" in str(found)


def test_blocks_ignore_what_is_marked_and_refuse_other_grids() -> None:
    marked = RING.copy()
    marked[5, :5] = 7
    found = tk.compare_blocks(CUT, marked, ignore=7, block_voxels=100)
    assert (found.betti_error, found.missing, found.spurious) == ((0, 0, 0), (0, None, 0), (0, None, 0))
    assert tk.compare_blocks(RING * 0, RING, block_voxels=100).missing == (1, None, 0)
    with pytest.raises(tk.InputError, match="resample"):
        tk.compare_blocks(RING, RING[1:])
    with pytest.raises(tk.InputError, match="pass level="):
        tk.compare_blocks(RING * 0.3 + np.arange(5) * 0.1, RING)


@pytest.mark.long
def test_workers_of_a_cluster_count_blocks(tmp_path) -> None:
    distributed = pytest.importorskip("distributed", reason="distributed is not installed; make test installs it")
    pair = volumes()
    for name, values in zip("ab", pair, strict=True):
        np.save(tmp_path / f"{name}.npy", values)
    paths = tmp_path / "a.npy", tmp_path / "b.npy"
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        found = tk.compare_blocks(*paths, level=0.5, block_voxels=5000, client=client)
    assert found == tk.compare_blocks(*paths, level=0.5, block_voxels=5000)


def test_meshes_clouds_and_functions_are_compared_as_solids() -> None:
    torus = tk.from_mesh(*torus_mesh(major=1, minor=0.4))
    ball = trimesh.creation.icosphere(radius=0.5)
    assert torus.compare(torus, resolution=40).is_same
    axis = np.linspace(-1.5, 1.5, 31)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    inside = np.hypot(np.hypot(x, y) - 1, z) < 0.4
    volume = tk.from_voxels(inside, spacing=0.1, origin=(-1.5, -1.5, -1.5))
    assert tk.compare(volume, torus, resolution=40).is_same
    plugged = tk.compare(trimesh.util.concatenate([trimesh.creation.icosphere(radius=1.4)]), torus, resolution=40)
    assert [one.kind for one in plugged.features] == ["filled tunnel"]
    assert plugged.resolution == pytest.approx(2.8 / 40)
    apart = tk.compare(ball, trimesh.creation.box(bounds=((5, 5, 5), (6, 6, 6))), resolution=30)
    assert apart.matched == (0, 0, 0)
    assert "do not meet" in apart.notes[0]
    with pytest.raises(tk.InputError, match="only two volumes"):
        tk.compare(torus, RING, level=0.5)


def test_the_grid_says_what_it_does_not_show() -> None:
    small = trimesh.creation.icosphere(radius=0.02)
    small.apply_translation((2, 0, 0))
    two = trimesh.util.concatenate([trimesh.creation.icosphere(radius=1), small])
    found = tk.from_mesh(two).compare(tk.from_mesh(trimesh.creation.icosphere(radius=1)), resolution=10)
    assert "its report counts 2, 0, 0" in found.notes[0]


@pytest.mark.long
def test_a_cloud_against_its_mesh() -> None:
    cloud = tk.from_points(torus_samples(5000).points)
    found = cloud.compare(tk.from_mesh(*torus_mesh(major=cloud.bounds[1][0] / 1.4, minor=0.4)), resolution=40)
    assert found.matched == (1, 1, 0)


def test_files_of_the_same_name_are_told_apart(tmp_path: Path) -> None:
    for folder, values in (("prediction", np.linspace(0, 1, 27)), ("truth", np.arange(27) > 9)):
        (tmp_path / folder).mkdir()
        np.save(tmp_path / folder / "case.npy", values.reshape(3, 3, 3))
    paths = [tmp_path / folder / "case.npy" for folder in ("prediction", "truth")]
    prediction, truth = (os.path.join(path.parent.name, path.name) for path in paths)
    assert tk.compare(*paths, level=0.5).names == (prediction, truth)
    with pytest.raises(tk.InputError, match=f"^{re.escape(prediction)}: the volume has more than the two values"):
        tk.compare(*paths)
