"""The small mesh files in tests/data: topology of the sound ones, flaws of the others."""

from __future__ import annotations

from pathlib import Path

import pytest
from write_test_files import DATA, FILES

import topokit as tk
from topokit.errors import InputError, ReadError

CLOSED = {
    "sphere.ply": (2, 1),
    "torus.stl": (0, 1),
    "torus_ascii.stl": (0, 1),
    "cube_quads.obj": (2, 1),
    "linked_tori.obj": (0, 2),
    "hollow_ball.off": (4, 2),
    "flipped_faces.ply": (2, 1),
    "unreferenced_vertex.obj": (2, 1),
}
REFUSED = ["truncated.stl", "wrong_index.obj"]


def test_the_files_are_those_of_the_script_and_small() -> None:
    found = [path for path in DATA.iterdir() if path.is_file()]
    assert {path.name for path in found} == set(FILES)
    assert sum(path.stat().st_size for path in found) < 300_000


@pytest.mark.parametrize("name", CLOSED)
def test_closed_meshes_are_counted(name: str) -> None:
    report = tk.load(DATA / name).report()
    euler, components = CLOSED[name]
    assert (report.euler, report.components, report.verdict, report.closed) == (euler, components, "certain", True)
    assert report.genus == components - euler // 2


@pytest.mark.parametrize("name", ["cube_quads.obj", "unreferenced_vertex.obj", "linked_tori.obj"])
def test_outward_faces_are_not_turned(name: str) -> None:
    assert not any("inward" in reason for reason in tk.load(DATA / name).report().reasons)


def test_flaws_are_counted() -> None:
    open_mesh = tk.load(DATA / "bowl.obj").report()
    assert (open_mesh.euler, open_mesh.closed, open_mesh.boundary_loops, open_mesh.verdict) == (1, False, 1, "certain")
    shared = tk.load(DATA / "edge_sharing_cubes.obj").report()
    assert (shared.closed, shared.verdict, shared.genus) == (False, "unsure", None)
    assert any("1 edge with three or more faces" in reason for reason in shared.reasons)
    flipped = tk.load(DATA / "flipped_faces.ply").report()
    assert any("10 faces" in reason and "flipped" in reason for reason in flipped.reasons)


@pytest.mark.parametrize("name", REFUSED)
def test_broken_files_are_refused_by_name(name: str) -> None:
    with pytest.raises(ReadError, match=name):
        tk.load(Path(DATA / name))


def test_a_file_without_faces_is_a_cloud() -> None:
    with pytest.raises(InputError, match=r"no_faces\.obj has 8 points, too few"):
        tk.load(DATA / "no_faces.obj").report()
