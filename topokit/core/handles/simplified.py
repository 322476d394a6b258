"""Closed meshes without the handles and tunnels that are narrower than a width.

Round after round, short loops that do not bound are found, as many as keep clear of each other are cut and capped, and
the result is counted, until none is left. A loop that runs around a handle bounds a disc inside the solid, and cutting
there cuts the handle; one that runs around a tunnel bounds a disc outside, and cutting there fills the tunnel. Which of
the loops together would take the surface apart, Kruskal's algorithm decides: the widest of these stay.

Caps must meet no other faces. This is checked for all loops of a round at once, since few do. From the round after the
first that did, each loop is also checked by itself before, so that the next one beside it is tried in the same round.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.blocks.planes import root_of
from topokit.core.handles.cycle_basis import edge_graph
from topokit.core.handles.small_loops import small_loops
from topokit.core.handles.surgery import Arrays, counted_cut, cut_and_capped, edges_of
from topokit.core.labels import connected_labels
from topokit.core.mesh.connectivity import mesh_connectivity
from topokit.core.mesh.defects import intersecting_faces
from topokit.core.progress import advance, begin, stages
from topokit.core.removal import How, Removal
from topokit.core.surface import vector_areas

_PERIMETER = 4.0  # length of the longest loop that is looked for, in widths: that around a square
_INWARD = (0.0, 0.25, 0.5)  # of the way from the middle of a loop to its corners: where the ball in it is looked for
_BEYOND = 2.0  # radii of a loop and of the faces around it, within which these and its caps may meet other faces
_STAGE = "handles below the width"


class Ring(NamedTuple):
    """A loop along which the mesh may be cut.

    Attributes:
        vertices: (N,) in order.
        width: diameter of the largest ball in it.
        place: its center (3,).
        how: whether the cap lies in the solid or in a tunnel.
    """

    vertices: Integers
    width: float
    place: Floats
    how: How


class Round(NamedTuple):
    """A closed mesh after a round, counted.

    Attributes:
        vertices: (V, 3).
        faces: (F, 3).
        removals: of all rounds so far.
        narrowest: width of the narrowest loop that was found and stays; infinite if none was.
    """

    vertices: Floats
    faces: Integers
    removals: list[Removal]
    narrowest: float


def without_small_handles(
    vertices: Floats, faces: Integers, below: float, ways: frozenset[How], check: bool
) -> Iterator[Round]:
    """A closed mesh with fewer and fewer of the handles that are narrower than a width; at last with none.

    Args:
        vertices: (V, 3).
        faces: (F, 3), closed, manifold and oriented outward.
        below: width, in units of the vertices.
        ways: "cut" for handles, "filled" for tunnels.
        check: whether loops whose caps would intersect the mesh are left; needs libigl.

    Raises:
        MissingDependencyError: with `check`, if libigl is not installed.
    """
    removals: list[Removal] = []
    refused: set[tuple[int, ...]] = set()
    n_found = 0
    with stages({_STAGE: 1.0}):
        begin(_STAGE)
        found, is_everywhere = small_loops(edge_graph(vertices, faces), _PERIMETER * below), True
        while True:
            n_refused = len(refused)
            rings, narrowest = _rings(vertices, faces, found.loops, below, ways, refused, check and n_refused > 0)
            chosen = _not_separating(faces, rings)
            n_found = max(n_found, len(removals) + len(chosen))
            n_vertices = len(vertices)
            vertices, faces, chosen = _cut(vertices, faces, chosen, refused, check)
            removals = removals + [_removal(ring) for ring in chosen]
            yield Round(vertices, faces, removals, narrowest)
            if chosen:
                roots = np.concatenate((found.roots, np.arange(n_vertices, len(vertices))))
                found, is_everywhere = small_loops(edge_graph(vertices, faces), _PERIMETER * below, roots), False
                advance(len(removals) / max(n_found, 1))
            elif len(refused) == n_refused and is_everywhere:
                return
            elif len(refused) == n_refused:
                found, is_everywhere = small_loops(edge_graph(vertices, faces), _PERIMETER * below), True


def _removal(ring: Ring) -> Removal:
    x, y, z = ring.place.tolist()
    n_caps = 1 if len(ring.vertices) == 3 else len(ring.vertices)
    return Removal("tunnel", ring.how, ring.width, (x, y, z), 2 * n_caps)


def _rings(
    vertices: Floats,
    faces: Integers,
    loops: list[tuple[float, Integers]],
    below: float,
    ways: frozenset[How],
    refused: set[tuple[int, ...]],
    each: bool,
) -> tuple[list[Ring], float]:
    """Of the loops, shortest first, those that may be cut and do not meet or neighbor each other; narrowest first.

    And how wide the narrowest of the others is that are as wide as asked or wider. If each loop is looked at by itself,
    those whose caps meet other faces are added to those that are refused.
    """
    normals = _normals(vertices, faces)
    order = np.argsort(faces.ravel(), kind="stable")
    begins = np.searchsorted(faces.ravel()[order], np.arange(len(vertices) + 1))
    taken = np.zeros(len(vertices), dtype=bool)
    is_crossed = None
    if each:
        tree, longest = cKDTree(vertices[faces].mean(axis=1)), _longest_edges(vertices, faces)
        is_crossed = partial(_is_crossed, vertices, faces, tree=tree, longest=longest)
    found, narrowest = [], np.inf
    for _, loop in loops:
        if taken[loop].any() or _name(loop) in refused:
            continue
        ring = _ring(vertices, normals, loop)
        narrowest = min(narrowest, ring.width if ring.width >= below else np.inf)
        if ring.width < below and ring.how in ways:
            if is_crossed is not None and is_crossed(ring):
                refused.add(_name(loop))
                continue
            found.append(ring)
            for vertex in loop:
                taken[faces[order[begins[vertex] : begins[vertex + 1]] // 3]] = True
    return sorted(found, key=lambda one: (one.width, one.vertices.tolist())), narrowest


def _name(loop: Integers) -> tuple[int, ...]:
    """What a loop is called, wherever it begins."""
    return tuple(np.sort(loop).tolist())


def _normals(vertices: Floats, faces: Integers) -> Floats:
    """Normals (V, 3) of the vertices, not of unit length."""
    areas = vector_areas(vertices[faces])
    return np.stack(
        [np.bincount(faces.ravel(), np.repeat(areas[:, axis], 3), len(vertices)) for axis in range(3)], axis=1
    )


def _ring(vertices: Floats, normals: Floats, loop: Integers) -> Ring:
    points = vertices[loop]
    middle = points.mean(axis=0)
    centers = np.concatenate([middle + share * (points - middle) for share in _INWARD])
    sides = np.concatenate((points, (points + np.roll(points, -1, axis=0)) / 2))
    radii = cKDTree(sides).query(centers)[0]
    best = int(radii.argmax())
    is_inside = float((normals[loop] * (points - middle)).sum()) > 0
    return Ring(loop, 2 * float(radii[best]), centers[best], "cut" if is_inside else "filled")


def _not_separating(faces: Integers, rings: list[Ring]) -> list[Ring]:
    """The rings along which the surface can be cut without coming apart; of others the widest stay."""
    if not rings:
        return []
    mesh = mesh_connectivity(faces)
    left, right = (half // 3 for half in mesh.twins)
    is_cut = edges_of(mesh, [ring.vertices for ring in rings])
    labels = connected_labels(len(faces), left[~is_cut], right[~is_cut])
    own = np.full(int(faces.max()) + 1, -1)
    for number, ring in enumerate(rings):
        own[ring.vertices] = number
    edge_of = np.zeros(len(rings), dtype=np.int64)
    edge_of[own[faces.ravel()[mesh.twins[0][is_cut]]]] = np.flatnonzero(is_cut)
    parent = np.arange(int(labels.max()) + 1)
    kept = []
    for ring, edge in zip(reversed(rings), edge_of[::-1].tolist(), strict=True):
        first, second = (root_of(parent, labels[half[edge]]) for half in (left, right))
        if first == second:
            kept.append(ring)
        parent[first] = second
    return kept[::-1]


def _cut(
    vertices: Floats, faces: Integers, rings: list[Ring], refused: set[tuple[int, ...]], check: bool
) -> tuple[Floats, Integers, list[Ring]]:
    """The mesh cut along the rings whose caps, all together, meet no other faces; the others become refused."""
    while rings:
        points, triangles = cut_and_capped(vertices, faces, [ring.vertices for ring in rings])
        crossed = _crossed((vertices, faces), (points, triangles), rings) if check else np.zeros(len(rings), dtype=bool)
        if not crossed.any():
            return *counted_cut(vertices, faces, points, triangles, len(rings)), rings
        refused |= {_name(ring.vertices) for ring, bad in zip(rings, crossed, strict=True) if bad}
        rings = [ring for ring, bad in zip(rings, crossed, strict=True) if not bad]
    return vertices, faces, []


def _is_crossed(vertices: Floats, faces: Integers, ring: Ring, tree: cKDTree, longest: Floats) -> bool:
    """Whether faces intersect beside a ring, if the mesh is cut along it alone.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        ring: along which the mesh would be cut.
        tree: of the middles of the faces.
        longest: (V,), the longest edge at each vertex.
    """
    near = tree.query_ball_point(ring.place, _looked_at(vertices, longest, ring))
    used, part = np.unique(faces[near], return_inverse=True)
    points, part, loop = vertices[used], part.reshape(-1, 3), np.searchsorted(used, ring.vertices)
    return bool(_crossed((points, part), cut_and_capped(points, part, [loop]), [ring._replace(vertices=loop)])[0])


def _looked_at(vertices: Floats, longest: Floats, ring: Ring) -> float:
    """How far around a ring's place faces are that it or its caps may meet; the longest edges are those whose ends
    move."""
    radius = np.linalg.norm(vertices[ring.vertices] - ring.place, axis=1).max()
    return _BEYOND * float(radius + longest[ring.vertices].max())


def _crossed(before: Arrays, after: Arrays, rings: list[Ring]) -> Booleans:
    """Whether faces intersect beside each of the rings that did not do so before."""
    (old_points, faces), (points, triangles) = before, after
    longest = _longest_edges(old_points, faces)
    reaches = [_looked_at(old_points, longest, ring) for ring in rings]
    near = cKDTree(points[triangles].mean(axis=1)).query_ball_point([ring.place for ring in rings], reaches)
    rows = np.unique(np.concatenate([np.asarray(one, dtype=np.int64) for one in near]))
    pairs = rows[intersecting_faces(points, triangles[rows])]
    old = rows[rows < len(faces)]
    known = old[intersecting_faces(old_points, faces[old])]
    size = len(triangles)
    pairs = pairs[~np.isin(_codes(pairs, size), _codes(known, size))]
    is_as_it_was = np.zeros(size, dtype=bool)  # two such faces meet, if at all, at the border of a part of a mesh
    is_as_it_was[: len(faces)] = (points[triangles[: len(faces)]] == old_points[faces]).all(axis=(1, 2))
    pairs = pairs[~is_as_it_was[pairs].all(axis=1)]
    crossed = np.zeros(len(rings), dtype=bool)
    if len(pairs):
        owner = np.repeat(np.arange(len(rings)), [len(ring.vertices) for ring in rings])
        tree = cKDTree(old_points[np.concatenate([ring.vertices for ring in rings])])
        away, nearest = tree.query(points[triangles[pairs]].mean(axis=2))
        crossed[owner[nearest[np.arange(len(pairs)), away.argmin(axis=1)]]] = True
    return crossed


def _longest_edges(vertices: Floats, faces: Integers) -> Floats:
    """The length of the longest edge at each vertex (V,)."""
    longest = np.zeros(len(vertices))
    for first, second in ((0, 1), (1, 2), (2, 0)):
        lengths = np.linalg.norm(vertices[faces[:, first]] - vertices[faces[:, second]], axis=1)
        for corner in (first, second):
            np.maximum.at(longest, faces[:, corner], lengths)
    return longest


def _codes(pairs: Integers, size: int) -> Integers:
    return pairs.min(axis=1) * size + pairs.max(axis=1)
