"""The counts of a mesh file under several weldings and after round trips, in Python and in the shell."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from topokit.cli.app import app
from topokit.testing import icosphere, torus_mesh
from topokit.tolerances import WIDE, ToleranceRow, tolerances


def rows_of(path: Path) -> dict[str, ToleranceRow]:
    return {row.reading: row for row in tolerances(path)}


@pytest.fixture
def stl(tmp_path: Path) -> Path:
    trimesh.Trimesh(*torus_mesh(24, 12), process=False).export(tmp_path / "torus.stl")
    return tmp_path / "torus.stl"


def test_loose_triangles_are_a_torus_once_equal_vertices_are_merged(stl: Path) -> None:
    rows = rows_of(stl)
    assert (rows["as stored"].components, rows["as stored"].closed) == (576, False)
    del rows["as stored"]
    assert {(row.vertices, row.euler, row.closed, row.genus) for row in rows.values()} == {(288, 0, True, 1)}
    for suffix in (".stl", ".obj", ".ply", ".glb"):
        assert f"written as {suffix} and read" in rows


def test_a_seam_of_1e_9_closes_in_single_precision_and_one_of_5e_5_only_within_the_widest(tmp_path: Path) -> None:
    """The upper half of a sphere is moved: what checkers say then depends on how they merge."""
    vertices, faces = icosphere(2)
    upper = vertices[faces].mean(axis=1)[:, 2] > 0
    for gap, closing in ((1e-9, "equal in single precision"), (5e-5, f"within {WIDE:g} of the diagonal")):
        moved = vertices * (1 + gap)
        both = np.concatenate((vertices, moved)), np.concatenate((faces[~upper], faces[upper] + len(vertices)))
        path = tmp_path / "seam.off"
        path.write_text(off(*both))
        rows = rows_of(path)
        assert not rows["as stored"].closed
        assert not rows["equal vertices merged"].closed
        assert rows[closing].closed
        assert rows[closing].euler == 2
        assert rows["equal in single precision"].closed == (gap < 1e-6)


def off(vertices: np.ndarray, faces: np.ndarray) -> str:
    lines = [f"OFF\n{len(vertices)} {len(faces)} 0"]
    lines += [" ".join(map(repr, row)) for row in vertices.tolist()]
    return "\n".join([*lines, *(f"3 {a} {b} {c}" for a, b, c in faces.tolist())])


def test_the_shell_prints_one_table(stl: Path) -> None:
    shown = CliRunner().invoke(app, ["report", str(stl), "--tolerances"])
    assert shown.exit_code == 0
    assert "genus 1" in shown.stdout.splitlines()[0]
    assert [line.split()[-2:] for line in shown.stdout.splitlines() if line.startswith("  as ")] == [
        ["yes", "1"],
        ["no", "0"],
    ]
    [record] = json.loads(CliRunner().invoke(app, ["report", str(stl), "--tolerances", "--json"]).stdout)
    assert [row["euler"] for row in record["tolerances"]][:3] == [0, 576, 0]
    assert CliRunner().invoke(app, ["report", str(stl), "--tolerances", "--csv"]).exit_code == 2


def test_points_have_no_table(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "points.xyz", icosphere(3)[0])
    shown = CliRunner().invoke(app, ["report", str(tmp_path / "points.xyz"), "--tolerances"])
    assert shown.exit_code == 1
    assert "is for meshes in files" in shown.stderr
