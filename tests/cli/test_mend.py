"""`topokit mend`: a file without narrow features, and a table of what was removed."""

from __future__ import annotations

import json
from pathlib import Path

import nibabel
import numpy as np
import pytest
import torch
import trimesh
from typer.testing import CliRunner, Result

import topokit as tk
from topokit.cli.app import app
from topokit.testing import icosphere, torus_mesh

SUFFIXES = (".npy", ".npz", ".nii", ".nii.gz", ".nrrd", ".mha", ".tif")


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Labels 0 and 2 in millimeters with an affine, a pinhole through them and a stray voxel."""
    labels = np.zeros((20, 16, 12), dtype=np.int16)
    labels[4:16, 4:12, 4:9] = 2
    labels[8, 8] = 0
    labels[1, 1, 1] = 2
    affine = np.array([[-0.5, 0, 0, 30], [0, 0.5, 0, -20], [0, 0, 1.0, 7], [0, 0, 0, 1]])
    path = tmp_path_factory.mktemp("mend") / "organ.nii.gz"
    nibabel.save(nibabel.Nifti1Image(labels, affine), path)
    return path


def test_a_volume_comes_back_in_its_format(image: Path) -> None:
    output = image.with_name("mended.nii.gz")
    shown = invoke("mend", image, "--label", "2", "-o", output, "--below", "1.5")
    assert shown.exit_code == 0, shown.stderr
    first, titles, *rows = shown.stdout.splitlines()
    assert first.startswith("Simplified below 1.5: 1 piece, 0 tunnels, 0 cavities (before: 2, 1, 0)")
    assert titles.split() == ["what", "how", "width", "place", "voxels"]
    assert sorted(row.split()[:2] for row in rows) == [["part", "dropped"], ["tunnel", "filled"]]
    before, after = nibabel.load(image), nibabel.load(output)
    assert np.array_equal(before.affine, after.affine)
    assert after.get_data_dtype() == np.int16
    assert 2 <= (np.asarray(before.dataobj) != np.asarray(after.dataobj)).sum() <= 4
    assert tk.load(output, label=2).betti().solid == (1, 0, 0)


def test_the_page_shows_before_and_after_and_where(image: Path) -> None:
    output, page = image.with_name("shown.npy"), image.with_name("shown.html")
    shown = invoke("mend", image, "--label", "2", "-o", output, "--below", "1.5", "--html", page)
    assert shown.exit_code == 0, shown.stderr
    text = page.read_text(encoding="utf-8")
    assert text.count('id="scene-') == 2
    assert [when in text for when in ("(before)", "(after)")] == [True, True]
    assert text.count("tunnel filled") == text.count("part dropped") == 2  # in both views


def test_the_table_as_json_and_what_is_kept(image: Path) -> None:
    output = image.with_name("kept.npy")
    options = ("--label", "2", "--below", "1.5", "--handles", "keep", "--json")
    shown = invoke("mend", image, "-o", output, *options)
    told = json.loads(shown.stdout)
    assert (told["before"], told["after"], told["changed"], told["unit"]) == ([2, 1, 0], [1, 1, 0], 1, "voxel")
    assert [one["how"] for one in told["removals"]] == ["dropped"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_volumes_are_written_with_sizes_and_places(image: Path, suffix: str) -> None:
    shape = tk.load(image, label=2)
    path = image.with_name(f"copy{suffix}")
    if suffix == ".tif":
        with pytest.raises(tk.InputError, match=r"\.tif holds uint8, uint16, float32; the volume is int16"):
            shape.save(path)
        shape = tk.from_voxels(shape.field.volume.to(torch.uint8), label=2, spacing=shape.field.grid.spacing)
    shape.save(path)
    again = tk.load(path, label=2)
    assert np.array_equal(shape.field.volume.numpy(), again.field.volume.numpy())
    place, other = shape.counted.placement, again.counted.placement
    if suffix != ".npy":
        assert other.spacing == pytest.approx(place.spacing)
    if suffix in (".nii", ".nii.gz", ".nrrd"):
        assert np.allclose(other.affine, place.affine)
    if suffix == ".mha":
        assert np.allclose(np.diag([-1, -1, 1, 1]) @ np.array(other.affine), place.affine)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_values_that_torch_cannot_compare_come_back_in_their_type(tmp_path: Path, suffix: str) -> None:
    values = np.zeros((12, 12, 9), dtype=np.uint16)
    values[2:10, 2:10, 2:7] = 60_000
    values[6, 6] = 0
    path, again = tmp_path / f"gray{suffix}", tmp_path / f"mended{suffix}"
    tk.from_voxels(values, level=30_000).save(path)
    shown = invoke("mend", path, "--level", "30000", "-o", again, "--below", "2")
    assert shown.exit_code == 0, shown.stderr
    mended = tk.load(again, level=30_000)
    assert (mended.genus(), mended.field.given_type) == (0, torch.uint16)
    assert set(mended.field.volume.unique().tolist()) == {0, 60_000}
    part = tk.from_labels(path)[60_000]
    part.save(again)
    assert tk.load(again, label=60_000).field.given_type == torch.uint16


def test_a_label_in_its_box_keeps_its_place_in_the_world(image: Path) -> None:
    part = tk.from_labels(image)[2]
    path = image.with_name("box.nii")
    part.save(path)
    box = tk.load(path, label=2)
    corner = np.array(box.counted.placement.affine) @ [*np.argwhere(box.field.volume.numpy() == 2)[0], 1]
    whole = nibabel.load(image)
    assert np.allclose(corner, whole.affine @ [*np.argwhere(np.asarray(whole.dataobj) == 2)[0], 1])


def test_a_mesh_comes_back_as_a_mesh(tmp_path: Path) -> None:
    path, output = tmp_path / "torus.off", tmp_path / "mended.stl"
    trimesh.Trimesh(*torus_mesh(24, 12, 1.0, 0.2), process=False).export(path)
    shown = invoke("mend", path, "-o", output, "--below", "0.5", "--keep-parts")
    assert shown.exit_code == 0, shown.stderr
    assert shown.stdout.splitlines()[2].split()[:2] == ["tunnel", "cut"]
    assert tk.genus(output) == 0


def test_boundaries_are_filled_on_request(tmp_path: Path) -> None:
    path, output = tmp_path / "open.off", tmp_path / "closed.ply"
    vertices, faces = icosphere(2)
    trimesh.Trimesh(vertices, faces[1:], process=False).export(path)
    refused = invoke("mend", path, "-o", output, "--below", "0.1")
    assert (refused.exit_code, output.exists()) == (1, False)
    assert "no closed surface" in refused.stderr
    assert "topokit mend --boundaries" in refused.stderr
    filled = invoke("mend", path, "-o", output, "--below", "0.1", "--boundaries")
    assert (filled.exit_code, filled.stdout.startswith("1 boundary loop filled. Nothing below 0.1 ")) == (0, True)
    assert tk.load(output).is_closed


@pytest.mark.parametrize("suffix", ["npy", "zarr"])
def test_a_volume_is_mended_block_by_block_into_a_file(tmp_path: Path, suffix: str) -> None:
    if suffix == "zarr":
        pytest.importorskip("zarr")
    labels = np.zeros((60, 40, 40), dtype=np.uint8)
    labels[5:55, 5:35, 5:35] = 3
    labels[20, 20] = labels[40, 20, 20] = 0  # a channel of one voxel, and a bubble
    np.save(tmp_path / "labels.npy", labels)
    output = tmp_path / f"mended.{suffix}"
    options = ("--label", "3", "--block-voxels", "30000", "--below", "2", "--json")
    shown = invoke("mend", tmp_path / "labels.npy", "-o", output, *options)
    assert shown.exit_code == 0, shown.stderr
    told = json.loads(shown.stdout)
    assert (told["before"], told["after"], told["unit"]) == ([1, 1, 1], [1, 0, 0], "voxel")
    assert sorted(one["kind"] for one in told["removals"]) == ["cavity", "tunnel"]
    written = tk.load(output, label=3).field.volume.numpy()
    assert (written.dtype, int((written != labels).sum())) == (np.uint8, told["changed"])
    wrong = invoke("mend", tmp_path / "labels.npy", "-o", tmp_path / "mended.nii", *options)
    assert wrong.exit_code == 1
    assert "written as .npy or .zarr" in wrong.stderr


def test_wrong_names_are_refused(image: Path, tmp_path: Path) -> None:
    wrong = invoke("mend", image, "--label", "2", "-o", tmp_path / "mended.stl", "--below", "1")
    assert wrong.exit_code == 1
    assert "is a volume, which is written as .npy" in wrong.stderr
    assert invoke("mend", image, "-o", tmp_path / "none" / "mended.npy", "--below", "1").exit_code == 2
    assert invoke("mend", image, "--label", "2", "-o", image, "--below", "1").exit_code == 1
    assert invoke("mend", image, "--label", "2", "-o", tmp_path / "a.npy", "--below", "0").exit_code == 2
