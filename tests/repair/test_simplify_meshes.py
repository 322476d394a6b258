"""`Shape.simplify` of meshes, points and splats: small handles go, the rest stays where it is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

import topokit as tk
from topokit.core.handles.cycle_basis import edge_graph
from topokit.core.handles.simplified import (
    Round,
    _crossed,
    _is_crossed,
    _longest_edges,
    _rings,
    without_small_handles,
)
from topokit.core.handles.small_loops import closed_form, small_loops
from topokit.core.handles.surgery import cut_and_capped
from topokit.core.mesh.defects import intersecting_faces
from topokit.core.mesh.topology import mesh_topology
from topokit.errors import InputError, Interrupted
from topokit.testing import genus_mesh, icosphere, torus_mesh, torus_samples

Mesh = tuple[np.ndarray, np.ndarray]


def last(rounds: Iterator[Round]) -> Round:
    *_, found = rounds
    return found


@pytest.fixture(scope="module")
def noisy_torus() -> Mesh:
    """With more than ten handles of a few voxels; its tunnel is 17 voxels wide."""
    return torus_with_noise(0.45)


def torus_with_noise(size: float) -> Mesh:
    """The largest component of a torus from a noisy volume."""
    axis = np.linspace(-1, 1, 40)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    field = 0.28 - np.hypot(np.hypot(x, y) - 0.6, z)
    field += size * gaussian_filter(np.random.default_rng(0).normal(size=field.shape), 1)
    vertices, faces, *_ = marching_cubes(np.pad(field, 1, constant_values=-1), 0)
    topology = mesh_topology(vertices.astype(float), faces.astype(np.int64))
    used, own = np.unique(topology.faces[topology.face_labels == 0], return_inverse=True)
    return vertices[used].astype(float), own.reshape(-1, 3)


def test_a_closed_form_tells_which_loops_bound() -> None:
    vertices, faces = torus_mesh(30, 15)
    graph = edge_graph(vertices, faces)
    keys = closed_form(graph)
    around = np.zeros(len(faces), dtype=np.int64)
    np.add.at(around, graph.left, keys)
    np.subtract.at(around, graph.right, keys)
    assert not around.any()
    ball = edge_graph(*icosphere(2))
    assert not closed_form(ball).any()
    assert small_loops(ball, 100.0).loops == []


def test_the_shortest_loops_are_those_around_the_tube() -> None:
    graph = edge_graph(*torus_mesh(60, 30, 1.0, 0.2))
    loops = small_loops(graph, 1.5).loops
    assert loops[0][0] == pytest.approx(2 * np.pi * 0.2, rel=0.01)
    assert all(len(loop) == 30 for _, loop in loops)
    assert small_loops(graph, 1.2).loops == []


def test_noise_goes_and_the_meant_handle_stays(noisy_torus: Mesh) -> None:
    vertices, faces = noisy_torus
    before = mesh_topology(vertices, faces)
    points, triangles, removals, _ = last(
        without_small_handles(vertices, faces, 6.0, frozenset({"cut", "filled"}), True)
    )
    after = mesh_topology(points, triangles)
    assert before.genus > 10
    assert (after.genus, after.is_closed, len(removals)) == (1, True, before.genus - 1)
    assert len(intersecting_faces(points, triangles)) == 0
    moved = (points[: len(vertices)] != vertices).any(axis=1)
    assert moved.sum() <= sum(one.changed for one in removals)
    assert {one.how for one in removals} == {"cut", "filled"}
    assert max(one.width for one in removals) < 6


def test_the_same_again_and_without_libigl_as_well(noisy_torus: Mesh) -> None:
    first, second = (
        last(without_small_handles(*noisy_torus, 4.0, frozenset({"cut"}), check)) for check in (True, False)
    )
    again = last(without_small_handles(*noisy_torus, 4.0, frozenset({"cut"}), False))
    assert np.array_equal(second[0], again[0])
    assert np.array_equal(second[1], again[1])
    assert {one.how for one in (*first[2], *second[2])} == {"cut"}


@pytest.mark.parametrize(
    ("mesh", "how", "width"),
    [(torus_mesh(60, 30, 1.0, 0.2), "cut", 0.4), (torus_mesh(60, 30, 1.0, 0.8), "filled", 0.4)],
)
def test_a_torus_is_cut_where_it_is_thin_and_filled_where_it_is_narrow(mesh: Mesh, how: str, width: float) -> None:
    shape = tk.from_mesh(*mesh)
    mended = shape.simplify(below=0.5, components=False)  # the whole of a thin torus is a thin part, too
    [removal] = mended.simplification.removals
    assert mended.genus() == 0
    assert (removal.kind, removal.how) == ("tunnel", how)
    assert removal.width == pytest.approx(width, rel=0.05)
    assert shape.simplify(below=0.3).genus() == 1
    other = "fill" if how == "cut" else "cut"
    assert shape.simplify(below=0.5, handles=other, components=False).genus() == 1
    vertices = mended.mesh[0].numpy()[: len(mesh[0])]
    assert (vertices != mesh[0]).any(axis=1).sum() <= 60
    assert mended.simplification.before == (1, 1, 0)
    assert mended.simplification.after == (1, 0, 0)


def test_small_parts_are_dropped_and_small_cavities_filled() -> None:
    parts = [icosphere(2, 1.0), icosphere(1, 0.1)]
    vertices = np.concatenate([parts[0][0], parts[1][0] + 2, parts[1][0]])
    n, m = len(parts[0][0]), len(parts[1][0])
    faces = np.concatenate([parts[0][1], parts[1][1] + n, parts[1][1][:, ::-1] + n + m])
    shape = tk.from_mesh(vertices, faces)
    assert shape.betti().solid == (2, 0, 1)
    assert shape.simplify(below=0.5).betti().solid == (1, 0, 0)
    assert shape.simplify(below=0.5, cavities=False).betti().solid == (1, 0, 1)
    assert shape.simplify(below=0.5, components=False).betti().solid == (2, 0, 0)
    with pytest.raises(InputError, match="every part is narrower"):
        shape.simplify(below=5)


def test_points_become_their_surface() -> None:
    cloud = torus_samples(1500, 1.0, 0.6)
    mended = tk.from_points(cloud.points, cloud.normals).simplify(below=1)
    assert mended.mesh is not None
    assert mended.genus() == 0


def test_splats_lose_their_floaters() -> None:
    ball = torch.nn.functional.normalize(torch.randn(600, 3, generator=torch.Generator().manual_seed(0)), dim=1)
    means = torch.cat((ball, 0.05 * ball[:10] + torch.tensor([3.0, 0, 0])))
    turned = torch.tensor([1.0, 0, 0, 0]).expand(610, 4)
    scene = tk.GaussianSplats(means, torch.full((610, 3), 0.1), turned, torch.ones(610))
    kept = scene.simplify(below=0.5)
    assert kept.rows.tolist() == list(range(600))
    assert "10 of 610 splats lie in clusters smaller than 0.5" in kept.notes[0]
    assert len(scene.simplify(below=0.01)) == 610
    with pytest.raises(InputError, match="positive length"):
        scene.simplify(below=-1)


def test_open_meshes_are_filled_first() -> None:
    vertices, faces = genus_mesh(2, 16)
    shape = tk.from_mesh(vertices, faces[3:])
    with pytest.raises(InputError, match="no closed surface"):
        shape.simplify(below=1)
    filled = shape.fill_boundaries()
    assert filled.genus() == 2
    assert filled.simplify(below=1, components=False).genus() == 0


def test_an_interrupt_leaves_what_was_mended(noisy_torus: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = tk.from_mesh(*noisy_torus)
    wanted = whole.simplify(below=6, components=False)
    rounds = iter([small_loops, small_loops, None])

    def interrupted(*args: object) -> object:
        search = next(rounds)
        if search is None:
            raise KeyboardInterrupt
        return search(*args)

    monkeypatch.setattr("topokit.core.handles.simplified.small_loops", interrupted)
    with pytest.raises(Interrupted) as stopped:
        whole.simplify(below=6, components=False)
    monkeypatch.undo()
    part = stopped.value.shape
    done = len(part.simplification.removals)
    assert part.genus() == whole.genus() - done
    assert done > 0
    rest = part.simplify(below=6, components=False)
    assert rest.genus() == wanted.genus() == 1
    assert len(rest.simplification.removals) == part.genus() - 1


def test_what_is_narrowest_is_said_where_nothing_is_narrower() -> None:
    made = tk.from_mesh(torus_mesh(major=1.0, minor=0.3)).simplify(below=0.5)
    assert made.simplification.removals == ()
    assert made.simplification.narrowest == pytest.approx(0.6, abs=0.02)
    assert "The narrowest that was seen is 0.597 wide." in made.simplification.summary()


def test_caps_beside_a_loop_meet_what_they_meet_in_the_whole_mesh() -> None:
    pytest.importorskip("igl")
    vertices, faces = torus_with_noise(0.8)
    loops = small_loops(edge_graph(vertices, faces), 24.0).loops
    rings, _ = _rings(vertices, faces, loops, 6.0, frozenset({"cut", "filled"}), set(), each=False)
    tree, longest = cKDTree(vertices[faces].mean(axis=1)), _longest_edges(vertices, faces)
    alone = [_is_crossed(vertices, faces, ring, tree, longest) for ring in rings]
    assert 0 < sum(alone) < len(rings)
    chosen = [*np.flatnonzero(alone)[:4], *np.flatnonzero(~np.array(alone))[:4]]
    for row in chosen:
        after = cut_and_capped(vertices, faces, [rings[row].vertices])
        assert _crossed((vertices, faces), after, [rings[row]]).tolist() == [alone[row]]
    refused: set[tuple[int, ...]] = set()
    others, _ = _rings(vertices, faces, loops, 6.0, frozenset({"cut", "filled"}), refused, each=True)
    assert len(refused) >= sum(alone)
    assert not any(_is_crossed(vertices, faces, ring, tree, longest) for ring in others)
