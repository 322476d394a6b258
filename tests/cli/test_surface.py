"""Surfaces and handles of a file are written and told in the coordinates of the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner, Result

from topokit.cli.app import app
from topokit.testing import icosphere

AFFINE = np.array([[-0.5, 0, 0, 30], [0, 0.5, 0, -20], [0, 0, 1.0, 7], [0, 0, 0, 1]])  # a mirror image
HOLE = AFFINE @ [12, 3.5, 2.5, 1]


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plate with a hole near one end."""
    nibabel = pytest.importorskip("nibabel")
    solid = np.zeros((20, 8, 6), dtype=np.uint8)
    solid[1:19, 1:7, 2:4] = 1
    solid[11:14, 3:5] = 0
    path = tmp_path_factory.mktemp("plate") / "plate.nii"
    nibabel.save(nibabel.Nifti1Image(solid, AFFINE), path)
    return path


def test_the_surface_of_a_volume_lies_where_its_file_says(plate: Path) -> None:
    found = invoke("surface", plate, "-o", plate.with_name("plate.ply"))
    assert found.exit_code == 0, found.stderr
    mesh = trimesh.load(plate.with_name("plate.ply"))
    assert (mesh.is_watertight, mesh.euler_number) == (True, 0)
    assert mesh.volume == pytest.approx((18 * 6 * 2 - 3 * 2 * 2) * 0.25, rel=0.1)  # turned inside out it is negative
    ends = AFFINE @ np.array([[0.5, 0.5, 1.5, 1], [18.5, 6.5, 3.5, 1]]).T
    assert np.allclose(np.sort(mesh.bounds, axis=0), np.sort(ends[:3].T, axis=0), atol=0.6)


def test_handles_of_a_volume_are_told_there_too(plate: Path) -> None:
    shown = invoke("handles", plate, "-o", plate.with_name("loops.glb"))
    center = [float(number) for number in shown.stdout.split()[2:]]
    assert np.allclose(center, HOLE[:3], atol=0.8)
    assert f"{round(center[0], 1):.1f}" in invoke("report", plate, "--locate").stdout
    low, high = trimesh.load(plate.with_name("loops.glb")).bounds
    assert (low <= HOLE[:3] + 1).all()
    assert (high >= HOLE[:3] - 1).all()


def test_what_is_open_or_called_otherwise_is_refused(tmp_path: Path) -> None:
    vertices, faces = icosphere(1)
    trimesh.Trimesh(vertices, faces[1:], process=False).export(tmp_path / "open.off")
    found = invoke("surface", tmp_path / "open.off", "-o", tmp_path / "out.ply")
    assert (found.exit_code, (tmp_path / "out.ply").exists()) == (1, False)
    assert "no closed surface" in found.stderr
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / "ball.off")
    assert ".glb" in invoke("surface", tmp_path / "ball.off", "-o", tmp_path / "out.vtk").stderr
    assert invoke("surface", tmp_path / "ball.off", "-o", tmp_path / "ball.stl").exit_code == 0
    assert trimesh.load(tmp_path / "ball.stl").euler_number == 2
