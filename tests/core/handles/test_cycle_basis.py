"""Tree–cotree bases: 2g loops and dual loops, closed, and dual to each other."""

from __future__ import annotations

import numpy as np
import pytest

from topokit.core.handles.cycle_basis import CycleBasis, cycle_basis, edge_graph
from topokit.testing import genus_mesh, icosphere, torus_mesh
from topokit.testing.meshes import Mesh


def basis_of(mesh: Mesh) -> CycleBasis:
    return cycle_basis(edge_graph(*mesh))


@pytest.mark.parametrize(
    ("mesh", "genus"),
    [(icosphere(2), 0), (torus_mesh(12, 8), 1), (genus_mesh(4, 12), 4)],
    ids=["sphere", "torus", "genus 4"],
)
def test_loops_are_closed_and_dual_to_dual_loops(mesh: Mesh, genus: int) -> None:
    basis = basis_of(mesh)
    graph = basis.graph
    assert len(basis.crossed) == 2 * genus
    ends = np.zeros((len(graph.tails), graph.n_vertices), dtype=int)
    ends[np.arange(len(ends)), graph.heads] += 1
    ends[np.arange(len(ends)), graph.tails] -= 1
    assert not (basis.loops @ ends).any(), "a loop has an end"
    sides = np.zeros((len(graph.tails), len(graph.faces)), dtype=int)
    sides[np.arange(len(sides)), graph.left] += 1
    sides[np.arange(len(sides)), graph.right] -= 1
    assert not (basis.crossings.T @ sides).any(), "a dual loop has an end"
    assert np.array_equal((basis.loops @ basis.crossings).toarray(), np.eye(2 * genus))


def test_boundaries_of_faces_have_class_zero_and_sums_add_up() -> None:
    basis = basis_of(genus_mesh(3, 12))
    for face in basis.graph.faces[::97]:
        assert not basis.class_of(face).any()
    torus = basis_of(torus_mesh(12, 8))
    around, tube = np.arange(12) * 8, 40 + np.arange(8)
    twice = np.concatenate((tube, tube))
    assert np.array_equal(torus.class_of(twice), 2 * torus.class_of(tube))
    assert np.array_equal(torus.class_of(around[::-1]), -torus.class_of(around))
    assert abs(round(np.linalg.det(np.stack((torus.class_of(around), torus.class_of(tube)))))) == 1


def test_intersection_numbers_are_those_of_known_loops() -> None:
    torus = basis_of(torus_mesh(12, 8))
    around, tube = torus.class_of(np.arange(12) * 8), torus.class_of(40 + np.arange(8))
    crossed = around @ torus.intersections @ tube
    assert abs(crossed) == 1
    assert tube @ torus.intersections @ around == -crossed
    assert (around + 3 * tube) @ torus.intersections @ tube == crossed
    assert (around + 3 * tube) @ torus.intersections @ around == -3 * crossed
    bar = basis_of(genus_mesh(3, 12))
    assert np.array_equal(bar.intersections, -bar.intersections.T)
    assert round(np.linalg.det(bar.intersections)) == 1
