"""Inside and outside by linking numbers: against the Gauss integral, on known loops, and on real meshes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from knotted_tube import knotted_tube
from numpy.typing import NDArray

import topokit as tk
from topokit.core.handles.cycle_basis import CycleBasis, cycle_basis, edge_graph
from topokit.core.handles.linking import is_projector, outside_projector
from topokit.core.mesh.topology import mesh_topology
from topokit.testing import genus_mesh, torus_mesh
from topokit.testing.meshes import Mesh, joined

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]


def solved(mesh: Mesh) -> tuple[CycleBasis, Integers]:
    basis = cycle_basis(edge_graph(*mesh))
    projector = outside_projector(mesh[0], basis)
    assert projector is not None
    return basis, projector


def outward_parts(mesh: Mesh) -> Iterator[tuple[int, Mesh]]:
    """Components with handles, facing out of the solid that all of them bound."""
    topology = mesh_topology(*mesh)
    for component in np.flatnonzero(topology.components.genera > 0):
        used, faces = np.unique(topology.faces[topology.face_labels == component], return_inverse=True)
        yield int(topology.components.genera[component]), (mesh[0][used], faces.reshape(-1, 3))


def side(basis: CycleBasis, projector: Integers, loop: Integers) -> str:
    own = basis.class_of(loop)
    assert own.any()
    beyond = own @ projector
    return "inside" if not beyond.any() else "outside" if np.array_equal(beyond, own) else "neither"


def gauss_linking(first: Floats, second: Floats) -> float:
    """Linking number of two closed polygons by the solid angles of Gauss's integral, pair by pair of their sides."""
    a, b = first[:, None], np.roll(first, -1, axis=0)[:, None]
    c, d = second[None], np.roll(second, -1, axis=0)[None]
    corners = [c - a, c - b, d - b, d - a]
    normals = [np.cross(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    normals = [normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-300) for normal in normals]
    angles = sum(np.arcsin(np.clip((normals[i - 1] * normals[i]).sum(axis=-1), -1, 1)) for i in range(4))
    signs = np.sign((np.cross(d - c, b - a) * (c - a)).sum(axis=-1))
    return float((angles * signs).sum() / (4 * np.pi))


def dual_polygon(mesh: Mesh, basis: CycleBasis, index: int, push: float) -> Floats:
    """Dual loop `index` as a polygon through edges' midpoints and faces' centers, pushed along the faces' normals."""
    vertices, graph = mesh[0], basis.graph
    column = basis.crossings[:, [index]].tocoo()
    step = {}
    for edge, sign in zip(column.row, column.data, strict=True):
        begin, end = (graph.right[edge], graph.left[edge])[:: int(sign)]
        step[int(begin)] = (int(edge), int(end))
    a, b, c = (vertices[graph.faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    polygon, face = [], next(iter(step))
    for _ in step:
        edge, other = step[face]
        middle = (vertices[graph.tails[edge]] + vertices[graph.heads[edge]]) / 2
        polygon += [(a + b + c)[face] / 3 + push * normals[face], middle + push * (normals[face] + normals[other]) / 2]
        face = other
    return np.array(polygon)


def ordered_loop(basis: CycleBasis, index: int) -> Integers:
    row = basis.loops[[index]].tocoo()
    tails, heads = basis.graph.tails[row.col], basis.graph.heads[row.col]
    after = dict(zip(np.where(row.data > 0, tails, heads), np.where(row.data > 0, heads, tails), strict=True))
    loop = [next(iter(after))]
    while len(loop) < len(after):
        loop.append(after[loop[-1]])
    return np.array(loop)


@pytest.mark.parametrize("mesh", [torus_mesh(24, 12), genus_mesh(2, 14)], ids=["torus", "genus 2"])
def test_linking_numbers_are_those_of_gauss_integral(mesh: Mesh) -> None:
    basis, projector = solved(mesh)
    size = len(projector)
    outside, inside = (
        [
            [gauss_linking(mesh[0][ordered_loop(basis, i)], dual_polygon(mesh, basis, j, push)) for j in range(size)]
            for i in range(size)
        ]
        for push in (0.01, -0.01)
    )
    assert np.allclose(np.rint(outside), outside, atol=1e-6)
    assert np.array_equal(np.rint(outside), -projector)
    assert np.array_equal(np.rint(inside), np.eye(size) - projector)


def test_known_loops_of_a_torus_and_of_the_torus_turned_inside_out() -> None:
    mesh = torus_mesh(24, 12)
    around, tube = np.arange(24) * 12, 60 + np.arange(12)
    basis, projector = solved(mesh)
    assert side(basis, projector, tube) == "inside"
    assert side(basis, projector, around) == "outside"
    slanted = np.arange(24) * 12 + np.arange(24) // 2
    assert side(basis, projector, slanted) == "neither"

    box = np.array([[x, y, z] for x in (-2, 2) for y in (-2, 2) for z in (-2.0, 2)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    box_faces = np.array([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])
    [(_, cavity)] = outward_parts(joined(mesh, (box, box_faces)))  # a ring-shaped cavity in a box
    assert np.array_equal(cavity[0], mesh[0])
    basis, projector = solved(cavity)
    assert side(basis, projector, tube) == "outside"
    assert side(basis, projector, around) == "inside"


def test_a_knotted_tube_is_bounded_outside_by_the_one_longitude_that_does_not_link_it() -> None:
    around, tube = 120, 8
    mesh, core = knotted_tube(around, tube)
    basis, projector = solved(mesh)
    meridian, longitude = np.arange(tube), np.arange(around) * tube
    assert side(basis, projector, meridian) == "inside"
    linking = round(gauss_linking(mesh[0][longitude], core))
    assert abs(linking) == 3, "the blackboard framing of a trefoil with three crossings"
    assert side(basis, projector, longitude) == "neither"
    turns = np.arange(-4, 5)[:, None]
    classes = basis.class_of(longitude) + turns * basis.class_of(meridian)
    bounds_outside = (classes @ projector == classes).all(axis=1)
    assert np.abs(turns[bounds_outside]).ravel().tolist() == [3]


def test_a_matrix_that_is_no_projector_is_noticed() -> None:
    assert is_projector(np.array([[1, -1], [0, 0]]))
    assert not is_projector(np.array([[1, 1], [1, 0]]))
    assert not is_projector(np.eye(2, dtype=np.int64))


def test_every_real_mesh_is_decided(real_data: Path) -> None:
    rows = json.loads((real_data / "index.json").read_text(encoding="utf-8"))
    decided = 0
    for row in rows:
        if row["kind"] != "mesh" or not row.get("genus") or row["F"] > 12_000:
            continue
        vertices, faces = (part.numpy() for part in tk.load(real_data / row["path"]).mesh)
        for genus, part in outward_parts((vertices.astype(float), faces)):
            assert np.trace(solved(part)[1]) == genus, row["name"]
        decided += 1
    assert decided >= 25
