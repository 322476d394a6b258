"""Volumes speak of their solid first, and of places by voxel index and in the coordinates of the file."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import topokit as tk
from topokit.cli.app import app
from topokit.pages import page_of

STEPS = (0.5, 0.5, 2.0)
OBLIQUE = np.eye(4)
OBLIQUE[:3, :3] = np.array([[0.6, -0.8, 0], [0, 0, -1], [0.8, 0.6, 0]]) @ np.diag(STEPS)
OBLIQUE[:3, 3] = 50, 90, -72


def organ() -> np.ndarray:
    """A slab with a tunnel around (20, 18) and a cavity of 4 × 4 × 2 voxels, and a stray voxel."""
    labels = np.zeros((42, 38, 20), np.uint8)
    labels[4:38, 4:34, 4:16] = 1
    x, y = np.mgrid[:42, :38]
    labels[(x - 20) ** 2 + (y - 18) ** 2 <= 16] = 0
    labels[6:10, 6:10, 8:10] = 0
    labels[1, 2, 3] = 1
    return labels


def written(tmp_path: Path) -> Path:
    nibabel = pytest.importorskip("nibabel", reason="nibabel is not installed; make test installs it")
    path = tmp_path / "organ.nii.gz"
    nibabel.save(nibabel.Nifti1Image(organ(), OBLIQUE), path)
    return path


def test_a_hollow_ball_is_one_piece_and_passes_where_pieces_are_asked_for(tmp_path: Path) -> None:
    ball = np.zeros((9, 9, 9), bool)
    ball[1:8, 1:8, 1:8] = True
    ball[4, 4, 4] = False
    np.save(tmp_path / "ball.npy", ball)
    report = tk.from_voxels(ball).report()
    assert (report.pieces, report.tunnels, report.cavities, report.solid_euler, report.euler) == (1, 0, 1, 2, 4)
    assert report.components == 2  # of the surface
    assert str(report).startswith("voxels: 1 piece, 0 tunnels, 1 cavity (χ of the solid 2, of its surface 4), certain")
    kept = json.loads(report.to_json())
    assert (kept["pieces"], kept["tunnels"], kept["solid_euler"]) == (1, 0, 2)

    def code(condition: str) -> int:
        return CliRunner().invoke(app, ["report", str(tmp_path / "ball.npy"), "--fail-on", condition]).exit_code

    assert [code(one) for one in ("components>1", "pieces>1", "cavities>0", "solid_euler!=2", "solid-euler>1")] == [
        *(1, 0, 1, 0, 1)
    ]
    mesh = tk.from_mesh(tk.from_voxels(ball).surface()).report()
    assert (mesh.pieces, mesh.solid_euler) == (1, 2)
    assert str(mesh).split(": ")[1].startswith("Euler characteristic 4")  # meshes speak of their surface


@pytest.mark.parametrize("in_blocks", [False, True])
def test_pieces_and_cavities_have_a_voxel_that_belongs_to_them(in_blocks: bool) -> None:
    options = {"block_voxels": 5000} if in_blocks else {}
    report = tk.from_voxels(organ(), **options).report(locate=True)
    large, cavity, stray = report.location.regions
    assert (large.kind, cavity.kind, stray.kind) == ("piece", "cavity", "piece")
    assert (large.volume, cavity.volume, stray.volume) == (organ().sum() - 1, 32, 1)
    assert (large.place.voxel, cavity.place.voxel, stray.place.voxel) == ((4, 4, 4), (6, 6, 8), (1, 2, 3))
    assert (cavity.center, stray.place.world) == ((7.5, 7.5, 8.5), None)
    assert "voxel (1, 2, 3)" in str(report)


def test_a_tunnel_is_found_at_its_axis_in_world_coordinates(tmp_path: Path) -> None:
    shape = tk.load(written(tmp_path))
    report = shape.report(locate=True)
    (handle,) = report.location.handles
    i, j, k = handle.place.voxel
    assert abs(i - 20) <= 1
    assert abs(j - 18) <= 1
    assert 3 <= k <= 16
    assert np.linalg.norm(handle.place.world - (OBLIQUE @ (20, 18, k, 1))[:3]) <= 0.5  # half a millimeter is a voxel
    assert (handle.place.unit, handle.place.space) == ("mm", "RAS")
    stray = report.location.regions[-1].place
    assert stray.world == pytest.approx((OBLIQUE @ (1, 2, 3, 1))[:3])
    page = page_of(shape, report).details
    for place in (handle.place, stray):
        assert ", ".join(map(str, place.voxel)) in page
        assert ", ".join(f"{x:.4g}" for x in place.world) in page
    assert "mm RAS" in str(report)


def test_all_coordinates_of_a_line_are_those_of_the_file(tmp_path: Path) -> None:
    report = tk.load(written(tmp_path)).report(locate=True)
    lines = {line.split()[0]: line for line in report.location.lines()}
    assert set(lines) == {"Piece", "Cavity", "Tunnel"}
    for line in lines.values():
        found = re.search(r" at \(([^)]*)\) mm RAS, voxel index \(([^)]*)\)", line)
        world, index = (np.array(list(map(float, one.split(",")))) for one in found.groups())
        np.testing.assert_allclose(world, (OBLIQUE @ (*index, 1))[:3], atol=np.linalg.norm(OBLIQUE[:3, :3]) / 2)
    cavity = report.location.regions[1]
    middle = re.search(r"middle of its box \(([^)]*)\) mm RAS\.$", lines["Cavity"])
    index = (np.array(cavity.center) - report.placement.origin) / report.placement.spacing
    expected = (OBLIQUE @ (*index, 1))[:3]
    np.testing.assert_allclose(list(map(float, middle[1].split(","))), expected, atol=1e-3)
    assert lines["Tunnel"].count("(") == lines["Piece"].count("(") - 1 == 2  # one place, with its index


def test_a_label_has_places_in_the_whole_volume(tmp_path: Path) -> None:
    pytest.importorskip("zarr", reason="zarr is not installed; make test installs it")
    for options in ({}, {"block_voxels": 9000}):
        volume = organ() if options else written(tmp_path)
        report = tk.from_labels(volume, **options)[1].report(locate=True)
        assert report.location.regions[1].place.voxel == (6, 6, 8)
    assert tk.load(written(tmp_path), spacing=1.0).report().placement.affine is None  # not the file's any more


def test_an_image_of_itk_is_placed_as_itk_places_it() -> None:
    itk = pytest.importorskip("SimpleITK", reason="SimpleITK is not installed; make test installs it")
    image = itk.GetImageFromArray(organ().transpose())
    image.SetSpacing(STEPS)
    image.SetOrigin((5.0, -7.0, 9.0))
    image.SetDirection((0.6, -0.8, 0, 0, 0, -1, 0.8, 0.6, 0))
    placement = tk.from_voxels(image).report().placement
    point = np.array((3, 4, 5)) * STEPS
    assert placement.voxel(point) == (3, 4, 5)
    assert placement.world(point) == pytest.approx(image.TransformIndexToPhysicalPoint((3, 4, 5)))
    assert (placement.unit, placement.space) == ("mm", "LPS")


def test_the_origin_of_a_nrrd_file_is_read(tmp_path: Path) -> None:
    nrrd = pytest.importorskip("nrrd", reason="pynrrd is not installed; make test installs it")
    header = {
        "space": "left-posterior-superior",
        "space directions": OBLIQUE[:3, :3].T,
        "space origin": OBLIQUE[:3, 3],
    }
    nrrd.write(str(tmp_path / "a.nrrd"), organ(), header)
    placement = tk.load(tmp_path / "a.nrrd").report().placement
    assert placement.spacing == pytest.approx(STEPS)
    assert placement.world(np.array((3, 4, 5)) * STEPS) == pytest.approx((OBLIQUE @ (3, 4, 5, 1))[:3])
    assert (placement.unit, placement.space) == ("mm", "LPS")


def test_a_folder_of_slices_is_a_volume(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile", reason="tifffile is not installed; make test installs it")
    folder = tmp_path / "slices"
    folder.mkdir()
    for number, image in enumerate(organ()):
        tifffile.imwrite(folder / f"z{number}.tif", image)  # z10 comes after z9
    report = tk.load(folder).report()
    assert report.solid_betti == tk.from_voxels(organ()).report().solid_betti == (2, 1, 1)
    found = CliRunner().invoke(app, ["report", str(folder)])
    assert "slices: 2 pieces, 1 tunnel, 1 cavity" in found.stdout
    tifffile.imwrite(folder / "z99.tif", image[:-1])
    with pytest.raises(tk.errors.ReadError, match=r"z99\.tif"):
        tk.load(folder)
    stacks = tmp_path / "stacks"
    stacks.mkdir()
    for name in ("a.tif", "b.tif"):
        tifffile.imwrite(stacks / name, organ())
    assert len(tk.survey(stacks).rows) == 2  # files with volumes stay files of their own
