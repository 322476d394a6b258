"""The handles of a file from the shell: lines, JSON, and loops as a file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import trimesh
from typer.testing import CliRunner, Result

from topokit.cli.app import app
from topokit.testing import icosphere, torus_mesh


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture(scope="module")
def torus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("handles") / "torus.off"
    trimesh.Trimesh(*torus_mesh(24, 12), process=False).export(path)
    return path


def test_one_line_per_handle_and_the_loops_in_a_file(torus: Path) -> None:
    shown = invoke("handles", torus, "-o", torus.with_name("loops.glb"))
    assert shown.exit_code == 0
    (line,) = shown.stdout.splitlines()
    around_handle, around_tunnel, *center = map(float, line.split("\t"))
    assert around_handle < around_tunnel
    assert len(center) == 3
    assert len(trimesh.load(torus.with_name("loops.glb")).geometry) == 2


def test_handles_and_places_as_json(torus: Path) -> None:
    (handle,) = json.loads(invoke("handles", torus, "--json").stdout)
    (report,) = json.loads(invoke("report", torus, "--json", "--locate").stdout)
    assert report["location"]["handles"] == [handle]
    assert json.loads(invoke("report", torus, "--json").stdout)[0]["location"] is None


def test_a_sphere_has_none_and_an_open_mesh_is_an_error(tmp_path: Path) -> None:
    vertices, faces = icosphere(1)
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / "sphere.off")
    trimesh.Trimesh(vertices, faces[1:], process=False).export(tmp_path / "open.off")
    sphere, opened = invoke("handles", tmp_path / "sphere.off"), invoke("handles", tmp_path / "open.off")
    assert (sphere.exit_code, sphere.stdout) == (0, "")
    assert opened.exit_code == 1
    assert "no closed surface" in opened.stderr


def test_several_files_are_told_apart_and_one_that_fails_stops_nothing(torus: Path, tmp_path: Path) -> None:
    for name in ("a.off", "b.off"):
        (tmp_path / name).write_bytes(torus.read_bytes())
    (tmp_path / "c.off").write_text("")
    shown = invoke("handles", tmp_path)
    assert shown.exit_code == 1
    assert [Path(line.split("\t")[5]).name for line in shown.stdout.splitlines()] == ["a.off", "b.off"]
    assert shown.stderr.count("1 handle.") == 2
    assert "c.off is empty" in shown.stderr
    rows = json.loads(invoke("handles", tmp_path / "a.off", tmp_path / "b.off", "--json").stdout)
    assert [Path(row["file"]).name for row in rows] == ["a.off", "b.off"]
    assert invoke("handles", tmp_path, "-o", tmp_path / "loops.glb").exit_code == 2


def test_more_handles_than_the_limit_are_an_error_at_once(torus: Path) -> None:
    shown = invoke("handles", torus, "--most", 0)
    assert (shown.exit_code, shown.stdout) == (1, "")
    assert "--most 1" in shown.stderr
