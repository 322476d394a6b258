"""Short bases of both sides: complete, on their sides, as short as by brute force, and found on coarse graphs too."""

from __future__ import annotations

import numpy as np
import pytest
from knotted_tube import knotted_tube
from numpy.typing import NDArray

from topokit.core.handles import cover, short_loops
from topokit.core.handles.annotated_graph import annotated, candidates
from topokit.core.handles.coarsening import coarsened
from topokit.core.handles.cycle_basis import CycleBasis, cycle_basis, edge_graph
from topokit.core.handles.linking import outside_projector
from topokit.testing import genus_mesh, torus_mesh
from topokit.testing.meshes import Mesh

Integers = NDArray[np.int64]


def solved(mesh: Mesh) -> tuple[CycleBasis, Integers]:
    vertices, faces = mesh
    basis = cycle_basis(edge_graph(vertices, faces))
    projector = outside_projector(vertices, basis)
    assert projector is not None
    return basis, projector


def check(basis: CycleBasis, projector: Integers, *, simple: bool = True) -> None:
    inside, outside = short_loops.short_loops(basis, projector)
    assert 2 * len(inside) == 2 * len(outside) == len(projector)
    for side, loops in enumerate((inside, outside)):
        for loop in loops:
            own = basis.class_of(loop.vertices)
            assert np.array_equal(own, loop.own_class)
            assert np.array_equal(own @ projector, side * own)
            assert not simple or len(np.unique(loop.vertices)) == len(loop.vertices)
            edges = basis.graph.between(loop.vertices, np.roll(loop.vertices, -1))[0]
            assert loop.length == pytest.approx(basis.graph.lengths[edges].sum())
    classes = np.stack([loop.own_class for loop in (*inside, *outside)])
    assert round(abs(np.linalg.det(classes))) == 1
    crossings = classes @ basis.intersections @ classes.T
    half = len(inside)
    assert not crossings[:half, :half].any(), "loops that bound on one side cross each other as often both ways"
    assert not crossings[half:, half:].any()
    assert round(abs(np.linalg.det(crossings[:half, half:]))) == 1


@pytest.mark.parametrize(
    "mesh", [torus_mesh(24, 12), genus_mesh(3, 12), knotted_tube(90, 8)[0]], ids=["torus", "genus 3", "knot"]
)
def test_both_sides_have_a_basis(mesh: Mesh) -> None:
    check(*solved(mesh))


def test_a_loop_too_wound_for_the_cover_is_put_together(monkeypatch: pytest.MonkeyPatch) -> None:
    basis, projector = solved(knotted_tube(60, 6)[0])
    monkeypatch.setattr(cover, "_SHEETS", 1)
    check(basis, projector, simple=False)


def test_the_shortest_loops_through_all_vertices_are_found() -> None:
    """On a bar with two holes: brute force over every root; both holes are alike, so are their loops."""
    basis, projector = solved(genus_mesh(2, 10))
    graph = annotated(basis, projector)
    inside, outside = short_loops.short_loops(basis, projector)
    shortest = [np.inf, np.inf]
    for root in range(graph.n_nodes):
        found = candidates(graph, root)
        for side in (0, 1):
            on_side = (found.keys[:, side] == 0) & (found.keys[:, 1 - side] != 0)
            shortest[side] = min(shortest[side], found.lengths[on_side].min(initial=np.inf))
    for best, loops in zip(shortest, (inside, outside), strict=True):
        assert best * (1 - 1e-9) <= loops[0].length <= 1.03 * best


def test_coarse_graphs_keep_all_classes(monkeypatch: pytest.MonkeyPatch) -> None:
    basis, projector = solved(genus_mesh(3, 14))
    fine = short_loops.short_loops(basis, projector)
    for n_cells in (400, 60):
        monkeypatch.setattr(short_loops, "_CELLS", n_cells)
        check(basis, projector)
        for loops, before in zip(short_loops.short_loops(basis, projector), fine, strict=True):
            lengths = np.array([[loop.length for loop in side] for side in (loops, before)])
            assert (lengths[0] <= 1.1 * lengths[1]).all()


def test_walks_of_a_coarse_graph_lift_to_walks_with_the_same_keys() -> None:
    basis, projector = solved(torus_mesh(30, 15))
    fine = annotated(basis, projector)
    coarse = coarsened(fine, 25)
    assert coarse.coarse.n_nodes <= 25
    found = candidates(coarse.coarse, 3)
    for row in range(0, len(found.edges), 5):
        nodes, edges = short_loops.closed_by(coarse.coarse, found.parents, int(found.edges[row]))
        walk = coarse.lifted(nodes, edges)
        passed, signs = fine.between(walk, np.roll(walk, -1))
        steps = fine.first[passed] + fine.second[passed]
        assert np.array_equal(steps, walk + np.roll(walk, -1)), "a step without an edge"
        key = signs @ fine.keys[passed]
        assert np.array_equal(key, found.keys[row]) or np.array_equal(key, -found.keys[row])
