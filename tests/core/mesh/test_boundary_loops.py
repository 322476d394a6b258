"""Boundary curves of meshes: as many as counted, in order, of the right length; and open ones at non-manifold edges."""

from __future__ import annotations

import math

import numpy as np
import pytest

from topokit.core.mesh.boundary_loops import mesh_boundary
from topokit.core.mesh.topology import mesh_topology
from topokit.testing import icosphere, torus_mesh


def test_a_closed_mesh_has_no_boundary() -> None:
    assert mesh_boundary(*torus_mesh(12, 8)) == ()


def test_the_loops_of_a_tube_are_its_two_circles_longest_first() -> None:
    vertices, faces = torus_mesh(60, 30, major=2.0, minor=0.5)
    x, y, _ = vertices[faces].mean(axis=1).T
    angle = np.arctan2(y, x)
    loops = mesh_boundary(vertices, faces[np.abs(angle) < 2])
    assert len(loops) == 2
    for loop in loops:
        assert loop.closed
        np.testing.assert_array_equal(loop.points, vertices[loop.index])
        assert loop.length == pytest.approx(math.pi, rel=0.15)  # zigzag along the grid's diagonals at most
        steps = np.linalg.norm(np.roll(loop.points, -1, axis=0) - loop.points, axis=1)
        assert loop.length == pytest.approx(steps.sum())
        np.testing.assert_array_equal(loop.bounds, (loop.points.min(axis=0), loop.points.max(axis=0)))


@pytest.mark.parametrize("seed", range(10))
def test_there_are_as_many_loops_as_counted_whatever_the_orientation(seed: int) -> None:
    draws = np.random.default_rng(seed)
    vertices, faces = icosphere(2)
    faces = faces[draws.random(len(faces)) < 0.85]
    faces[::3] = faces[::3, ::-1]
    loops = mesh_boundary(vertices, faces)
    topology = mesh_topology(vertices, faces)
    assert len(loops) == topology.boundary_loops > 0
    assert sum(len(loop.points) for loop in loops) == topology.boundary_edges
    assert [loop.length for loop in loops] == sorted((loop.length for loop in loops), reverse=True)


def test_a_curve_that_ends_at_a_non_manifold_edge_is_open() -> None:
    vertices = np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 1, 0], [-1, -1, 0]])
    loops = mesh_boundary(vertices, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]))  # three pages of a book
    assert sorted(loop.closed for loop in loops) == [False, True] or not any(loop.closed for loop in loops)
    assert sum(len(loop.points) - (not loop.closed) for loop in loops) == 6
