"""Counting against known meshes, trimesh as oracle, and every fault a mesh can have."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from topokit.core.components import SurfaceComponent
from topokit.core.mesh.topology import mesh_topology
from topokit.testing import genus_mesh, icosphere, torus_mesh
from topokit.testing.meshes import Mesh


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    vertices = np.concatenate([vertices for vertices, _ in meshes])
    return vertices, np.concatenate([faces + start for (_, faces), start in zip(meshes, starts, strict=False)])


def moved(mesh: Mesh, offset: float) -> Mesh:
    return mesh[0] + offset, mesh[1]


@pytest.mark.parametrize("genus", [1, 2, 3, 6])
def test_genus(genus: int) -> None:
    topology = mesh_topology(*genus_mesh(genus))
    assert topology.is_closed
    assert topology.is_orientable
    assert (topology.euler, topology.genus) == (2 - 2 * genus, genus)
    assert topology.inward_components == 0


def test_open_meshes_count_their_loops() -> None:
    vertices, faces = icosphere(2)
    topology = mesh_topology(vertices, faces[1:])
    assert not topology.is_closed
    assert topology.is_manifold
    assert (topology.euler, topology.boundary_loops, topology.genus) == (1, 1, 0)
    away = np.linalg.norm(vertices[faces].mean(1) - vertices[faces[0]].mean(0), axis=1).argmax()
    topology = mesh_topology(vertices, np.delete(faces, [0, away], axis=0))
    assert (topology.euler, topology.boundary_loops, topology.boundary_edges) == (0, 2, 6)


def test_holes_that_touch_pinch_a_vertex() -> None:
    vertices, faces = icosphere(2)
    start = faces[0, 0]
    fan = np.flatnonzero((faces == start).any(axis=1))
    opposite = [face for face in fan if len(np.intersect1d(faces[face], faces[fan[0]])) == 1]
    topology = mesh_topology(vertices, np.delete(faces, [fan[0], opposite[0]], axis=0))
    assert (topology.pinched_vertices, topology.boundary_edges, topology.genus) == (1, 6, None)
    assert topology.boundary_loops == 1  # the two fans taken apart leave one curve


@pytest.mark.parametrize(("twist", "loops", "orientable", "genus"), [(False, 2, True, 0), (True, 1, False, None)])
def test_cylinder_and_moebius_band(twist: bool, loops: int, orientable: bool, genus: int | None) -> None:
    n = 24
    angle = np.arange(n) * 2 * np.pi / n
    ring = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    vertices = np.concatenate([np.c_[ring, np.full(n, z)] for z in (0.0, 1.0)])
    here, there = np.arange(n), np.roll(np.arange(n), -1)
    low, high = there.copy(), there + n
    if twist:
        low[-1], high[-1] = high[-1], low[-1]
    topology = mesh_topology(vertices, np.concatenate((np.c_[here, low, high], np.c_[here, high, here + n])))
    assert (topology.euler, topology.boundary_loops) == (0, loops)
    assert (topology.is_orientable, topology.genus) == (orientable, genus)


def test_non_manifold_edge_and_pinched_vertex() -> None:
    cube = trimesh.creation.box()
    sharing_edge = trimesh.util.concatenate([cube, cube.copy().apply_translation((1, 1, 0))])
    sharing_edge.merge_vertices()
    topology = mesh_topology(sharing_edge.vertices, np.asarray(sharing_edge.faces))
    assert (topology.nonmanifold_edges, topology.pinched_vertices, topology.euler) == (1, 0, 3)
    assert topology.genus is None
    sharing_corner = trimesh.util.concatenate([cube, cube.copy().apply_translation((1, 1, 1))])
    sharing_corner.merge_vertices()
    topology = mesh_topology(sharing_corner.vertices, np.asarray(sharing_corner.faces))
    assert (topology.nonmanifold_edges, topology.pinched_vertices, topology.euler) == (0, 1, 3)
    assert not topology.is_closed


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 0.45))
def test_flipped_faces_are_counted_and_turned(seed: int, share: float) -> None:
    vertices, faces = torus_mesh(30, 15)
    flip = np.random.default_rng(seed).random(len(faces)) < share
    topology = mesh_topology(vertices, np.where(flip[:, None], faces[:, ::-1], faces))
    assert topology.flipped_faces == flip.sum()
    assert (topology.euler, topology.genus) == (0, 1)
    turned = trimesh.Trimesh(vertices, topology.faces, process=False)
    assert turned.is_winding_consistent
    assert turned.volume > 0


def test_nested_shells_and_their_directions() -> None:
    ball = joined(icosphere(2, 3.0), icosphere(2, 2.0), icosphere(2, 1.0), moved(icosphere(2, 0.5), 10.0))
    topology = mesh_topology(*ball)
    assert [component.depth for component in topology.components] == [0, 1, 2, 0]
    assert [component.inside for component in topology.components] == [None, 0, 1, None]
    assert topology.inward_components == 1  # the shell of radius 2 bounds a cavity, so outward means into it
    volumes = [
        trimesh.Trimesh(ball[0], topology.faces[topology.face_labels == i], process=False).volume for i in range(4)
    ]
    assert [volume > 0 for volume in volumes] == [True, False, True, True]
    assert sum(component.area_share for component in topology.components) == pytest.approx(1)


@pytest.mark.parametrize("seed", range(20))
def test_counts_agree_with_trimesh_on_random_triangle_soups(seed: int) -> None:
    rng = np.random.default_rng(seed)
    faces = rng.integers(0, 14, (25, 3))
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    vertices = rng.random((14, 3))
    topology = mesh_topology(vertices, faces)
    oracle = trimesh.Trimesh(vertices, faces, process=False)
    assert topology.euler == oracle.euler_number
    assert sum(component.euler for component in topology.components) == topology.euler
    assert topology.boundary_edges == len(trimesh.grouping.group_rows(oracle.edges_sorted, require_count=1))
    assert topology.is_closed == (oracle.is_watertight and topology.is_manifold)


def test_a_soup_of_loose_triangles_is_counted_as_one_array() -> None:
    rng = np.random.default_rng(0)
    n_loose = 20_000
    corners = 4 * rng.random((n_loose, 1, 3)) - 2 + 0.01 * rng.normal(size=(n_loose, 3, 3))
    shells = joined(icosphere(2, 1.0), icosphere(1, 0.5))
    vertices, faces = joined(shells, (corners.reshape(-1, 3), np.arange(3 * n_loose).reshape(-1, 3)))
    topology = mesh_topology(vertices, faces)
    components = topology.components
    assert len(components) == n_loose + 2
    assert (topology.euler, topology.genus, topology.boundary_loops) == (n_loose + 4, 0, n_loose)
    assert components[0].bounds == ((-1, -1, -1), (1, 1, 1))
    distance = np.linalg.norm(corners, axis=2).max(axis=1)
    is_outside = np.linalg.norm(corners, axis=2).min(axis=1) > 1
    depth_of_face = components.depths[topology.face_labels[-n_loose:]]
    assert (depth_of_face[is_outside] == 0).all()
    assert (depth_of_face[distance < 0.45] == 2).all()
    assert (distance < 0.45).sum() > 50
    assert is_outside.sum() > 10_000
    assert (depth_of_face[(distance < 0.9) & (np.linalg.norm(corners, axis=2).min(axis=1) > 0.55)] == 1).all()


def test_many_bubbles_in_one_shell_are_cavities() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(12.0)] * 3), axis=-1).reshape(-1, 3)
    vertices, faces = icosphere(0, 0.3)
    bubbles = (vertices + grid[:, None]).reshape(-1, 3)
    bubble_faces = (faces + len(vertices) * np.arange(len(grid))[:, None, None]).reshape(-1, 3)
    topology = mesh_topology(*joined(moved(icosphere(4, 12.0), 5.5), (bubbles, bubble_faces)))
    assert topology.components.cavities == len(grid)
    assert topology.inward_components == len(grid)
    assert (topology.components.inside[1:] == 0).all()


def test_components_are_a_sequence_of_their_rows() -> None:
    vertices, faces = icosphere(1)
    topology = mesh_topology(*joined((vertices, faces[1:]), moved(torus_mesh(12, 8), 5.0)))
    components = topology.components
    assert len(components) == 2
    assert [type(one) for one in components] == [SurfaceComponent] * 2
    assert (components[0].genus, components[-1].boundary_loops) == (1, 1)
    assert components[:1] == (components[0],)
    assert components == tuple(components)
    assert components != tuple(components)[::-1]
    assert hash(components) == hash(tuple(components))
    with pytest.raises(IndexError):
        components[2]


def test_a_mesh_with_a_non_manifold_part_has_no_genus() -> None:
    book = np.random.default_rng(0).random((5, 3)), np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])  # three pages
    topology = mesh_topology(*joined(torus_mesh(12, 8, major=9.0), book))
    assert (topology.nonmanifold_edges, topology.genus) == (1, None)
    assert [component.genus for component in topology.components] == [1, None]


@pytest.mark.parametrize("scale", [1e-200, 1e-3, 1e200])
def test_areas_and_directions_do_not_depend_on_the_unit(scale: float) -> None:
    vertices, faces = joined(icosphere(1, 2.0), moved((icosphere(1)[0], icosphere(1)[1][:, ::-1]), 9.0))
    topology = mesh_topology(scale * vertices, faces)
    assert topology.inward_components == 1
    assert [one.area_share for one in topology.components] == pytest.approx([0.8, 0.2])
