"""Cutting and filling: counted by topokit and by trimesh, for all handles, in any order, on any closed surface."""

from __future__ import annotations

import json
from operator import attrgetter
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import trimesh
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from planted_noise import planted

import topokit as tk
from topokit.core.handles.find import find_handles
from topokit.core.handles.repair import without_boundary
from topokit.core.handles.simplified import without_small_handles
from topokit.core.handles.surgery import without_loops
from topokit.core.mesh.topology import mesh_topology
from topokit.core.removal import Removal
from topokit.errors import InputError
from topokit.testing import genus_mesh, icosphere, torus_mesh
from topokit.testing.meshes import Mesh, joined

Floats = NDArray[np.float64]
Kind = Literal["handle", "tunnel"]


def without_all(mesh: Mesh, kind: Kind) -> Mesh:
    """Every handle removed along loops of one kind, one after the other, each counted."""
    vertices, faces = mesh[0], mesh_topology(*mesh).faces
    while found := find_handles(vertices, mesh_topology(vertices, faces), lambda *mesh: mesh):
        genus = len(found)
        assert genus == mesh_topology(vertices, faces).genus
        taken: set[int] = set()
        for handle in sorted(found, key=attrgetter(f"{kind}_length")):
            loop = getattr(handle, f"{kind}_vertices")
            if taken.isdisjoint(loop.tolist()):
                taken |= set(loop.tolist())
                vertices, faces = without_loops(vertices, faces, [loop])
                genus -= 1
                body = trimesh.Trimesh(vertices, faces, process=False)
                assert body.is_watertight
                assert body.is_winding_consistent
                topology = mesh_topology(vertices, faces)
                assert (topology.genus, topology.is_closed) == (genus, True)
        assert taken
    return vertices, faces


@pytest.mark.parametrize("kind", ["handle", "tunnel"])
@pytest.mark.parametrize("genus", [1, 2, 5])
def test_all_handles_can_be_cut_or_filled_until_a_sphere_is_left(genus: int, kind: Kind) -> None:
    mesh = genus_mesh(genus, 14)
    vertices, faces = without_all(mesh, kind)
    assert mesh_topology(vertices, faces).euler == 2
    assert np.isclose(vertices[: len(mesh[0])], mesh[0], atol=0.2).all()


@given(seed=st.integers(0, 10_000))
@settings(max_examples=8, deadline=None)
def test_any_random_solid_becomes_spheres(seed: int) -> None:
    from skimage.measure import marching_cubes

    generator = np.random.default_rng(seed)
    field = np.full((13, 13, 13), -1.0)
    coarse = generator.normal(size=(5, 5, 5))
    steps = np.linspace(0, 4, 11)
    low = np.minimum(steps.astype(int), 3)
    share = steps - low
    for axis in range(3):
        lower, upper = np.take(coarse, low, axis), np.take(coarse, low + 1, axis)
        weight = share.reshape([-1 if own == axis else 1 for own in range(3)])
        coarse = (1 - weight) * lower + weight * upper
    field[1:-1, 1:-1, 1:-1] = coarse
    vertices, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="descent")
    mesh = vertices.astype(np.float64), faces.astype(np.int64)
    topology = mesh_topology(*mesh)
    if not topology.is_closed:
        reject()  # marching cubes pinched an edge
    for kind in ("handle", "tunnel"):
        after = mesh_topology(*without_all(mesh, kind))
        assert after.euler == 2 * len(after.components) == 2 * len(topology.components)


def test_ten_planted_handles_and_tunnels_are_found_smallest_first_and_removed() -> None:
    base = joined(icosphere(5), moved(torus_mesh(80, 40, 1, 0.4), 3.0))
    vertices, faces = planted(base, 10, np.random.default_rng(1))
    found = find_handles(vertices, mesh_topology(vertices, faces), lambda *mesh: mesh)
    sizes = [handle.size for handle in found]
    assert sizes == sorted(sizes)
    assert len(found) == 11
    small = found[:10]
    assert max(sizes[:10]) < 0.1 < sizes[10]
    for handle in small:
        assert handle.shorter.min() >= len(base[0]), "the shorter loop runs around a tube"
    assert 3 <= sum(handle.handle_length < handle.tunnel_length for handle in small) <= 7, "handles and tunnels"
    points, triangles, removals = simplified(vertices, faces, 0.1)
    after = mesh_topology(points, triangles)
    assert (after.genus, after.is_closed, len(after.components)) == (1, True, 2)
    assert np.array_equal(points[: len(base[0])], base[0])
    assert len(removals) == 10
    assert simplified(points, triangles, 0.1)[2] == [], "nothing is left to do"


def simplified(
    vertices: Floats, faces: NDArray[np.int64], below: float
) -> tuple[Floats, NDArray[np.int64], list[Removal]]:
    """Without the small handles, whether or not caps meet something."""
    closed = mesh_topology(vertices, faces).faces
    *_, last = without_small_handles(vertices, closed, below, frozenset({"cut", "filled"}), check=False)
    return last.vertices, last.faces, last.removals


def moved(mesh: Mesh, by: float) -> Mesh:
    return mesh[0] + by, mesh[1]


def test_boundaries_are_filled_even_where_they_touch() -> None:
    vertices, faces = icosphere(2)
    touching = np.flatnonzero((faces == 3).any(axis=1))[[0, 2]]
    far = np.flatnonzero((faces == 60).any(axis=1))
    is_open = np.delete(faces, np.concatenate((touching, far)), axis=0)
    before = mesh_topology(vertices, is_open)
    assert before.pinched_vertices == 1
    points, triangles = without_boundary(vertices, before)
    after = mesh_topology(points, triangles)
    assert (after.euler, after.is_closed, len(after.components)) == (2, True, 1)
    assert np.array_equal(points[: len(vertices)], vertices)


def test_what_cannot_be_filled_or_cut_is_refused() -> None:
    vertices, faces = icosphere(1)
    three_at_an_edge = np.concatenate((faces, [[*faces[0, :2], 41]]))
    with pytest.raises(InputError, match="three faces"):
        without_boundary(vertices, mesh_topology(vertices, three_at_an_edge))
    with pytest.raises(InputError, match="χ"):
        without_loops(vertices, faces, [faces[0]])  # cuts a triangle out
    torus = torus_mesh(12, 8)
    with pytest.raises(InputError, match="Subdivide"):
        without_loops(*torus, [np.concatenate((np.arange(8), np.arange(8)))])


def test_triangles_without_area_do_no_harm() -> None:
    vertices, faces = genus_mesh(2, 14)
    before = [handle.size for handle in find_handles(vertices, mesh_topology(vertices, faces), lambda *mesh: mesh)]
    for a, b, _ in np.random.default_rng(0).choice(faces, 60, replace=False):
        vertices[b] = vertices[a]
    found = find_handles(vertices, mesh_topology(vertices, faces), lambda *mesh: mesh)
    assert np.allclose([handle.size for handle in found], before, rtol=0.05)
    points, triangles, _ = simplified(vertices, faces, 100.0)
    assert mesh_topology(points, triangles).euler == 2


def test_a_surface_through_itself_has_no_inside() -> None:
    vertices, faces = torus_mesh(40, 20, 1, 0.3)
    half = vertices[:, 0] > 0
    vertices[half, 1] *= -0.2  # half of the ring is turned over and passes through the other
    with pytest.raises(InputError, match="intersects itself"):
        find_handles(vertices, mesh_topology(vertices, faces), lambda *mesh: mesh)


@pytest.mark.long
def test_real_meshes_are_cut_and_filled_to_spheres(real_data: Path) -> None:
    """The smaller ones; `benchmarks/handles.py` does it for all."""
    rows = json.loads((real_data / "index.json").read_text(encoding="utf-8"))
    done = 0
    for row in rows:
        if row["kind"] == "mesh" and row["clean_truth"] and row["genus"] and row["F"] < 6000:
            vertices, faces = (part.numpy() for part in tk.load(real_data / row["path"]).mesh)
            for kind in ("handle", "tunnel"):
                after = mesh_topology(*without_all((vertices.astype(float), faces), kind))
                assert after.euler == 2 * row["components"], row["name"]
            done += 1
    assert done >= 12
