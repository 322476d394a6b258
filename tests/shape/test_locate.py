"""Reports that say where: handles, boundaries and defects with sizes and places, in text, JSON and files."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from plyfile import PlyData

import topokit as tk
from topokit.errors import InputError
from topokit.export import save_loops
from topokit.report.location import Location
from topokit.testing import icosphere, torus_mesh, torus_samples

pytest.importorskip("igl")


def location(shape: tk.Shape) -> Location:
    found = shape.report(locate=True).location
    assert found is not None
    return found


@pytest.fixture(scope="module")
def torus() -> Location:
    return location(tk.from_mesh(torus_mesh(40, 20, major=1.0, minor=0.4)))


@pytest.fixture(scope="module")
def bowl() -> Location:
    vertices, faces = icosphere(3)
    faces = faces[vertices[faces].mean(axis=1)[:, 2] < 0.3].copy()
    faces[4] = faces[4, ::-1]
    return location(tk.from_mesh(vertices, faces))


def test_nothing_is_located_unless_asked() -> None:
    report = tk.from_mesh(icosphere(1)).report()
    assert report.location is None
    assert report.to_dict()["location"] is None


def test_the_handle_of_a_torus_is_located(torus: Location) -> None:
    (handle,) = torus.handles
    assert handle.handle_length == pytest.approx(2 * math.pi * 0.4, rel=0.05)
    assert handle.tunnel_length == pytest.approx(2 * math.pi * 0.6, rel=0.05)
    np.testing.assert_allclose(handle.center, (0, 0, 0), atol=1e-9)
    assert torus.boundaries == torus.defects == torus.notes == ()


def test_json_holds_lengths_centers_and_bounds_but_no_curves() -> None:
    report = tk.from_mesh(torus_mesh(20, 10)).report(locate=True)
    place = json.loads(report.to_json())["location"]
    assert set(place) == {"handles", "boundaries", "defects", "notes", "regions"}
    known = {"handle_length", "tunnel_length", "center", "bounds", "component", "place"}
    assert set(place["handles"][0]) == known
    assert "around the handle" in str(report)


def test_the_boundary_and_a_flipped_face_of_a_bowl_are_located(bowl: Location) -> None:
    (boundary,) = bowl.boundaries
    assert boundary.closed
    assert 2 * math.pi * 0.94 < boundary.length < 2 * math.pi * 1.3
    assert [(defect.kind, defect.faces) for defect in bowl.defects] == [("flipped faces", 1)]
    text = "\n".join(bowl.lines())
    assert "Boundary at" in text
    assert "Defects, flipped faces: at 1 place, the largest with 1 face at" in text


def test_the_handle_of_a_cloud_is_located_and_a_sphere_has_nothing() -> None:
    assert len(location(tk.from_points(torus_samples(2000).points)).handles) == 1
    assert location(tk.from_mesh(icosphere(2))).lines() == ()


def test_what_cannot_be_located_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "igl.predicates", None)
    assert "Self-intersections were not located" in location(tk.from_mesh(icosphere(1))).notes[0]
    cut = location(tk.from_sdf(lambda p: p[:, 2], bounds=((-1, -1, -1), (1, 1, 1)), resolution=128))
    assert "Boundaries were not located" in cut.notes[0]


def test_loops_are_written_as_edges_of_a_ply(torus: Location, bowl: Location, tmp_path: Path) -> None:
    assert save_loops(torus, tmp_path / "loops.ply") == 2
    written = PlyData.read(str(tmp_path / "loops.ply"))
    points = np.stack([written["vertex"][axis] for axis in "xyz"], axis=1)
    ends = np.stack([written["edge"][name] for name in ("vertex1", "vertex2")], axis=1)
    lengths = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    n_first = len(torus.handles[0].handle_loop)
    assert lengths[:n_first].sum() == pytest.approx(torus.handles[0].handle_length)
    assert lengths[n_first:].sum() == pytest.approx(torus.handles[0].tunnel_length)
    assert len({tuple(row) for row in np.stack([written["edge"][c] for c in ("red", "green", "blue")], 1)}) == 2
    assert save_loops(bowl, tmp_path / "bowl.ply") == 2  # the boundary, and the corners of the flipped face
    bowl_ply = PlyData.read(str(tmp_path / "bowl.ply"))
    assert len(bowl_ply["vertex"].data) == len(bowl_ply["edge"].data) + 3


def test_loops_are_written_as_lines_of_a_gltf(torus: Location, tmp_path: Path) -> None:
    assert save_loops(torus, tmp_path / "loops.glb") == 2
    paths = trimesh.load(tmp_path / "loops.glb").geometry.values()
    curves = [path.vertices[path.entities[0].points] for path in paths]
    lengths = [np.linalg.norm(np.diff(curve, axis=0), axis=1).sum() for curve in curves]
    assert lengths == pytest.approx([torus.handles[0].handle_length, torus.handles[0].tunnel_length], rel=1e-4)


def test_files_that_cannot_be_written_are_refused(torus: Location, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"does not end with \.ply or \.glb"):
        save_loops(torus, tmp_path / "loops.obj")
    with pytest.raises(InputError, match="does not exist"):
        save_loops(torus, tmp_path / "missing" / "loops.ply")
    with pytest.raises(InputError, match="nothing was located"):
        save_loops(Location((), (), (), ()), tmp_path / "loops.ply")


def test_a_speck_and_a_cavity_of_a_mesh_are_located() -> None:
    block, speck, bubble = trimesh.creation.box((4, 4, 4)), *(trimesh.creation.icosphere(2, r) for r in (0.2, 1.0))
    bubble.invert()
    report = tk.report(trimesh.util.concatenate([block, speck.apply_translation((3, 0, 1)), bubble]), locate=True)
    assert [(one.kind, one.center) for one in report.location.regions] == [
        ("piece", pytest.approx((0, 0, 0))),
        ("cavity", pytest.approx((0, 0, 0))),
        ("piece", pytest.approx((3, 0, 1))),
    ]
    assert "0.4 × 0.4 × 0.4 large" in report.text()
    assert tk.report(block, locate=True).location.regions == ()
