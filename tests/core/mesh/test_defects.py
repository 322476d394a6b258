"""Defects of meshes: planted ones are found, with their faces and their place, and clean meshes have none."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import topokit as tk
from topokit.core.mesh.defects import Defect, mesh_defects
from topokit.errors import InputError, MissingDependencyError
from topokit.testing import icosphere, shell_mesh, torus_mesh, torus_samples
from topokit.testing.meshes import joined

pytest.importorskip("igl")


def found(vertices: np.ndarray, faces: np.ndarray, **options: bool) -> dict[str, list[Defect]]:
    kinds: dict[str, list[Defect]] = {}
    for defect in mesh_defects(np.asarray(vertices, dtype=float), np.asarray(faces), **options):
        assert (defect.points >= np.array(defect.bounds[0])).all()
        assert (defect.points <= np.array(defect.bounds[1])).all()
        kinds.setdefault(defect.kind, []).append(defect)
    return kinds


@pytest.mark.parametrize("mesh", [torus_mesh(20, 10), icosphere(3)], ids=["torus", "sphere"])
def test_clean_meshes_have_no_defects(mesh: tuple[np.ndarray, np.ndarray]) -> None:
    assert mesh_defects(*mesh) == ()


def test_crossing_spheres_intersect_along_one_curve() -> None:
    vertices, faces = icosphere(3)
    kinds = found(*joined((vertices, faces), (vertices + np.array([1.2, 0.01, 0.02]), faces)))
    assert list(kinds) == ["self-intersection"]
    (defect,) = kinds["self-intersection"]
    np.testing.assert_allclose(np.mean(defect.bounds, axis=0)[0], 0.6, atol=0.1)
    radius = np.linalg.norm(defect.points[:, 1:], axis=1)
    assert abs(radius - 0.8).max() < 0.25  # near the circle in which the spheres cross


def test_two_separate_intersections_are_two_defects() -> None:
    vertices, faces = icosphere(2)
    pins = [(0.1 * vertices + [0, 0, z], faces) for z in (1.0, -1.0)]
    kinds = found(*joined((vertices, faces), *pins))
    assert [round(float(np.mean(one.points[:, 2]))) for one in kinds["self-intersection"]] in ([1, -1], [-1, 1])


def test_flipped_duplicate_and_degenerate_faces() -> None:
    vertices, faces = torus_mesh(20, 10)
    flipped = faces.copy()
    flipped[[5, 6, 200]] = flipped[[5, 6, 200], ::-1]
    kinds = found(vertices, flipped)
    assert list(kinds) == ["flipped faces"]
    assert sorted(row for one in kinds["flipped faces"] for row in one.faces) == [5, 6, 200]

    kinds = found(vertices, np.vstack((faces, faces[[7]])), self_intersections=False)
    assert [one.faces.tolist() for one in kinds["duplicate faces"]] == [[7, len(faces)]]
    assert kinds["non-manifold edges"]

    edge = vertices[faces[0, :2]].mean(axis=0)
    flat = np.vstack((vertices, edge))
    kinds = found(flat, np.vstack((faces, [[faces[0, 0], faces[0, 1], len(vertices)]])), self_intersections=False)
    assert [one.faces.tolist() for one in kinds["degenerate faces"]] == [[len(faces)]]


def test_non_manifold_edges_and_pinched_vertices_are_where_they_are() -> None:
    vertices = np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 1, 0], [-1, -1, 0], [0, 0, -1], [1, 0, -1]])
    book = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    kinds = found(vertices, book, self_intersections=False)
    (edge,) = kinds["non-manifold edges"]
    np.testing.assert_array_equal(edge.points, vertices[:2])
    np.testing.assert_array_equal(edge.faces, [0, 1, 2])
    kinds = found(vertices, np.array([[0, 1, 2], [0, 5, 6]]), self_intersections=False)
    (pinched,) = kinds["pinched vertex"]
    np.testing.assert_array_equal(pinched.points, vertices[:1])
    np.testing.assert_array_equal(pinched.faces, [0, 1])


def test_tiny_components_and_cavities() -> None:
    crumb = icosphere(1)[0] * 0.004 + [3, 0, 0], icosphere(1)[1]
    shell = shell_mesh(2)
    kinds = found(*joined(shell, crumb))
    assert sorted(kinds) == ["cavity", "tiny component"]
    n_shell = len(shell[1])
    assert kinds["tiny component"][0].faces.min() == n_shell
    np.testing.assert_allclose(kinds["cavity"][0].bounds, 0.9 * np.array([[-1] * 3, [1] * 3]), atol=0.02)
    assert sorted(kinds["cavity"][0].faces) == list(range(n_shell // 2, n_shell))


def test_a_component_inside_out_is_one_unless_it_bounds_a_cavity() -> None:
    vertices, faces = icosphere(1)
    shell, outside = shell_mesh(2), (0.5 * vertices + np.array([3.0, 0, 0]), faces[:, ::-1])
    kinds = found(*joined(shell, outside))
    assert sorted(kinds) == ["cavity", "inverted component"]
    (inverted,) = kinds["inverted component"]
    np.testing.assert_array_equal(inverted.faces, len(shell[1]) + np.arange(len(faces)))
    np.testing.assert_allclose(np.mean(inverted.bounds, axis=0), (3, 0, 0), atol=0.01)
    assert "cavity" in (turned := found(shell[0], shell[1][:, ::-1]))
    assert turned["inverted component"][0].faces.max() < len(shell[1]) / 2  # the outer half


def test_a_shape_tells_its_defects_as_the_mesh_was_given() -> None:
    vertices, faces = icosphere(2)
    faces = faces.copy()
    faces[11] = faces[11, ::-1]
    (defect,) = tk.from_mesh(vertices, faces).to("cpu").defects()
    assert (defect.kind, defect.faces.tolist()) == ("flipped faces", [11])
    with pytest.raises(InputError, match="not made from a mesh"):
        tk.from_points(torus_samples(500).points).defects()


def test_without_libigl_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "igl.predicates", None)
    shape = tk.from_mesh(icosphere(1))
    with pytest.raises(MissingDependencyError, match=r"topokit\[defects\]"):
        shape.defects()
    assert shape.defects(self_intersections=False) == ()
