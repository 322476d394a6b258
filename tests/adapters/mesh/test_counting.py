"""Which reading of a mesh is counted: as given, with equal vertices merged, with nearly equal ones."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from topokit.adapters.mesh import counting
from topokit.adapters.mesh.counting import count_mesh
from topokit.core.mesh.connectivity import MeshConnectivity, mesh_connectivity
from topokit.testing import genus_mesh, icosphere, torus_mesh
from topokit.testing.meshes import Mesh


def loose(mesh: Mesh) -> Mesh:
    vertices, faces = mesh
    return vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of faces of the meshes whose edges were sorted."""
    sizes: list[int] = []

    def connectivity(faces: NDArray[np.int64]) -> MeshConnectivity:
        sizes.append(len(faces))
        return mesh_connectivity(faces)

    monkeypatch.setattr(counting, "mesh_connectivity", connectivity)
    return sizes


def test_a_soup_is_welded_before_it_is_counted(counted: list[int]) -> None:
    vertices, faces = loose(torus_mesh(30, 20))
    found = count_mesh(vertices, faces)
    assert counted == [len(faces)]
    assert (found.topology.euler, found.topology.is_closed, found.exact_vertices) == (0, True, True)
    assert found.notes == ("3000 vertices merged with an equal one, which closes the mesh.",)


def test_a_closed_mesh_is_counted_once(counted: list[int]) -> None:
    count_mesh(*torus_mesh(30, 20))
    assert counted == [1200]


def test_twenty_thousand_loose_triangles(counted: list[int]) -> None:
    n_loose = 20_000
    rng = np.random.default_rng(0)
    corners = rng.random((n_loose, 1, 3)) + 0.01 * rng.normal(size=(n_loose, 3, 3))
    vertices, faces = corners.reshape(-1, 3), np.arange(3 * n_loose).reshape(-1, 3)
    ball_vertices, ball_faces = loose(icosphere(2, 0.3))
    together = np.concatenate((vertices, ball_vertices + 0.5))
    found = count_mesh(together, np.concatenate((faces, ball_faces + 3 * n_loose)))
    topology = found.topology
    assert counted == [n_loose + len(ball_faces)]
    assert (len(topology.components), topology.euler) == (n_loose + 1, n_loose + 2)
    assert (topology.boundary_loops, topology.boundary_edges) == (n_loose, 3 * n_loose)
    distance = np.linalg.norm(corners - 0.5, axis=2)
    depths = topology.components.depths[topology.face_labels[:n_loose]]
    assert (depths[distance.max(axis=1) < 0.28] == 1).all()
    assert (depths[distance.min(axis=1) > 0.3] == 0).all()
    assert 1000 < depths.sum() < 4000


def test_a_split_seam_with_shared_vertices_elsewhere(counted: list[int]) -> None:
    vertices, faces = torus_mesh(30, 20)
    seam_vertices, seam_faces = loose((vertices, faces[:100]))
    mesh = np.concatenate((vertices, seam_vertices)), np.concatenate((faces[100:], seam_faces + len(vertices)))
    found = count_mesh(*mesh)
    assert len(counted) == 2
    assert (found.topology.euler, found.topology.is_closed) == (0, True)


@pytest.mark.parametrize(("noise", "closed"), [(1e-10, True), (1e-6, False)])
def test_only_rounding_errors_are_merged(noise: float, closed: bool) -> None:
    vertices, faces = loose(genus_mesh(1, 8))
    vertices = vertices + np.random.default_rng(0).uniform(-noise, noise, vertices.shape)
    found = count_mesh(vertices, faces)
    assert (found.topology.is_closed, found.exact_vertices) == (closed, not closed)
    assert found.topology.euler == (0 if closed else len(faces))


def test_a_rounded_seam_in_a_mesh_with_a_real_hole_stays_open() -> None:
    vertices, faces = loose(torus_mesh(20, 10))
    vertices = vertices + np.random.default_rng(0).uniform(-1e-10, 1e-10, vertices.shape)
    found = count_mesh(vertices, faces[1:])
    assert not found.topology.is_closed
    assert len(found.topology.components) == len(faces) - 1


def test_merging_that_makes_faults_is_not_done() -> None:
    vertices, faces = icosphere(1)
    sheets = np.concatenate((vertices, vertices)), np.concatenate((faces[1:], faces + len(vertices)))
    found = count_mesh(*sheets)
    assert found.notes == ()
    assert (found.topology.nonmanifold_edges, found.topology.boundary_edges) == (0, 3)
