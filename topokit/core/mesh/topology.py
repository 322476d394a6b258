"""Exact topology of triangle meshes by counting: V − E + F, boundary loops, manifoldness, orientation, nesting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from topokit.core.components import SurfaceComponent
from topokit.core.mesh.winding_number import contains

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MeshTopology:
    """What counting says about a mesh.

    Attributes:
        euler: V − E + F, unreferenced vertices and degenerate faces left out.
        components: the components, largest area first.
        boundary_loops: closed boundary curves in all, as they are once pinched vertices are taken apart.
        boundary_edges, nonmanifold_edges: edges with one face; with three or more.
        pinched_vertices: vertices whose faces form more than one fan.
        flipped_faces: faces against the majority's orientation in their component.
        inward_components: closed components whose faces point into the solid as given.
        is_orientable: whether one consistent orientation exists.
        faces: (F, 3) the faces used, oriented consistently and outward (out of the solid) where that is possible.
        face_labels: (F,) index into `components`.
    """

    euler: int
    components: tuple[SurfaceComponent, ...]
    boundary_loops: int
    boundary_edges: int
    nonmanifold_edges: int
    pinched_vertices: int
    flipped_faces: int
    inward_components: int
    is_orientable: bool
    faces: Integers
    face_labels: Integers

    @property
    def is_manifold(self) -> bool:
        """Every edge has at most two faces and every vertex one fan."""
        return self.nonmanifold_edges == 0 and self.pinched_vertices == 0

    @property
    def is_closed(self) -> bool:
        """A closed manifold: no boundary, no non-manifold edge, no pinched vertex."""
        return self.is_manifold and self.boundary_edges == 0

    @property
    def genus(self) -> int | None:
        """Handles summed over components, (2c − b − χ)/2, or None if that has no meaning."""
        handles = [component.genus for component in self.components]
        return None if any(one is None for one in handles) else sum(one for one in handles if one is not None)


def mesh_topology(vertices: Floats, faces: Integers) -> MeshTopology:
    """Count a triangle mesh by its indices (equal coordinates are not merged here).

    Args:
        vertices: (V, 3).
        faces: (F, 3), indices in range, no repeated index within a face, F ≥ 1.
    """
    edges, face_edges, edge_uses, directions = _edges(faces)
    corner_fans, n_fans = _fans(faces, face_edges)
    labels = _vertex_connected(faces, len(vertices))
    n_components = int(labels.max()) + 1
    areas = triangle_areas(vertices, faces)
    order = np.argsort(-np.bincount(labels, areas, n_components), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(n_components)
    labels = rank[labels]
    used = np.unique(faces)
    vertex_labels = np.full(len(vertices), -1)
    vertex_labels[faces.ravel()] = np.repeat(labels, 3)
    edge_labels = vertex_labels[edges[:, 0]]
    euler = (
        np.bincount(vertex_labels[used], minlength=n_components)
        - np.bincount(edge_labels, minlength=n_components)
        + np.bincount(labels, minlength=n_components)
    )
    oriented, flipped, orientable = _orient(faces, face_edges, edge_uses, directions, labels, n_components)
    loops = _boundary_loops(faces, face_edges, edge_uses, corner_fans, labels, n_components)
    pinched = _pinched(faces, corner_fans, n_fans, len(vertices))
    closed = _is_clean(n_components, edge_labels[edge_uses != 2], vertex_labels[pinched])
    manifold = _is_clean(n_components, edge_labels[edge_uses > 2], vertex_labels[pinched])
    bounds = [_bounds(vertices, oriented[labels == index]) for index in range(n_components)]
    parents, depths = _nesting(vertices, oriented, labels, closed, bounds)
    oriented, inward = _outward(vertices, oriented, labels, closed & orientable, depths)
    shares = np.bincount(labels, areas, n_components) / max(areas.sum(), np.finfo(float).tiny)
    components = tuple(
        SurfaceComponent(
            euler=int(euler[index]),
            genus=int(2 - loops[index] - euler[index]) // 2 if manifold[index] and orientable[index] else None,
            boundary_loops=int(loops[index]),
            bounds=(tuple(bounds[index][0].tolist()), tuple(bounds[index][1].tolist())),
            area_share=float(shares[index]),
            inside=parents[index],
            depth=int(depths[index]),
        )
        for index in range(n_components)
    )
    return MeshTopology(
        euler=int(euler.sum()),
        components=components,
        boundary_loops=int(loops.sum()),
        boundary_edges=int((edge_uses == 1).sum()),
        nonmanifold_edges=int((edge_uses > 2).sum()),
        pinched_vertices=len(pinched),
        flipped_faces=flipped,
        inward_components=inward,
        is_orientable=bool(orientable.all()),
        faces=oriented,
        face_labels=labels,
    )


def triangle_areas(vertices: Floats, faces: Integers) -> Floats:
    """Areas of the triangles, (F,)."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def connected_labels(n_nodes: int, first: Integers, second: Integers) -> Integers:
    """Label of the connected component of every node, given the two ends of each edge."""
    graph = coo_array((np.ones(len(first), dtype=bool), (first, second)), shape=(n_nodes, n_nodes))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _edges(faces: Integers) -> tuple[Integers, Integers, Integers, NDArray[np.bool_]]:
    """Undirected edges (E, 2), edge of each half-edge (F, 3), faces per edge (E,), direction of each half-edge (F, 3).

    Half-edge i of a face runs from its corner i to its corner i + 1.
    """
    halves = np.stack((faces, np.roll(faces, -1, axis=1)), axis=-1).reshape(-1, 2)
    n_vertices = int(faces.max()) + 1
    keys = halves.min(axis=1) * n_vertices + halves.max(axis=1)
    unique, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    edges = np.stack((unique // n_vertices, unique % n_vertices), axis=1)
    return edges, inverse.reshape(-1, 3), counts, (halves[:, 0] < halves[:, 1]).reshape(-1, 3)


def _linked_halves(face_edges: Integers) -> tuple[Integers, Integers]:
    """Half-edges (flat indices 3 f + i) that lie on the same edge, as a chain of pairs along each edge."""
    flat = face_edges.ravel()
    order = np.argsort(flat, kind="stable")
    same = flat[order[:-1]] == flat[order[1:]]
    return order[:-1][same], order[1:][same]


def _fans(faces: Integers, face_edges: Integers) -> tuple[Integers, int]:
    """Label of the fan that each corner (flat index 3 f + i) belongs to: corners of a vertex joined across edges."""
    first, second = _linked_halves(face_edges)
    corners = faces.ravel()

    def ends(half: Integers) -> tuple[Integers, Integers]:
        face, side = half // 3, half % 3
        return half, 3 * face + (side + 1) % 3

    (a, b), (c, d) = ends(first), ends(second)
    same = corners[a] == corners[c]
    rows = np.concatenate((a, b))
    columns = np.concatenate((np.where(same, c, d), np.where(same, d, c)))
    labels = connected_labels(len(corners), rows, columns)
    return labels, int(labels.max()) + 1


def _pinched(faces: Integers, corner_fans: Integers, n_fans: int, n_vertices: int) -> Integers:
    vertex_of_fan = np.zeros(n_fans, dtype=np.int64)
    vertex_of_fan[corner_fans] = faces.ravel()
    return np.flatnonzero(np.bincount(vertex_of_fan, minlength=n_vertices) > 1)


def _vertex_connected(faces: Integers, n_vertices: int) -> Integers:
    first = np.concatenate((faces[:, 0], faces[:, 1]))
    second = np.concatenate((faces[:, 1], faces[:, 2]))
    labels = connected_labels(n_vertices, first, second)[faces[:, 0]]
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)


def _is_clean(n_components: int, *faults: Integers) -> NDArray[np.bool_]:
    clean = np.ones(n_components, dtype=bool)
    for labels in faults:
        clean[labels] = False
    return clean


def _boundary_loops(
    faces: Integers,
    face_edges: Integers,
    edge_uses: Integers,
    corner_fans: Integers,
    labels: Integers,
    n_components: int,
) -> Integers:
    """Boundary curves per component, as they are once the fans of pinched vertices are taken apart."""
    half = np.flatnonzero(edge_uses[face_edges.ravel()] == 1)
    if len(half) == 0:
        return np.zeros(n_components, dtype=np.int64)
    start, end = corner_fans[half], corner_fans[3 * (half // 3) + (half % 3 + 1) % 3]
    curves = connected_labels(int(corner_fans.max()) + 1, start, end)[start]
    _, one_each = np.unique(curves, return_index=True)
    return np.bincount(labels[half[one_each] // 3], minlength=n_components)


def _orient(
    faces: Integers,
    face_edges: Integers,
    edge_uses: Integers,
    directions: NDArray[np.bool_],
    labels: Integers,
    n_components: int,
) -> tuple[Integers, int, NDArray[np.bool_]]:
    """Faces turned to agree with the majority of their patch, how many were turned, and which components allow it.

    Works on two copies of every face, as given and turned over: neighbours that agree join like to like, others
    crosswise. A patch in which a face meets its own turned copy is not orientable and is left as it is.
    """
    first, second = _linked_halves(face_edges)
    is_manifold = edge_uses[face_edges.ravel()[first]] == 2
    first, second = first[is_manifold], second[is_manifold]
    agree = directions.ravel()[first] != directions.ravel()[second]
    a, b = first // 3, second // 3
    n_faces = len(faces)
    turned = np.where(agree, b, b + n_faces), np.where(agree, b + n_faces, b)
    sheets = connected_labels(2 * n_faces, np.concatenate((a, a + n_faces)), np.concatenate(turned))
    given, opposite = sheets[:n_faces], sheets[n_faces:]
    is_twisted = given == opposite
    sizes = np.bincount(given, minlength=int(sheets.max()) + 1)
    flip = ~is_twisted & ((sizes[given] < sizes[opposite]) | ((sizes[given] == sizes[opposite]) & (given > opposite)))
    oriented = np.where(flip[:, None], faces[:, ::-1], faces)
    return oriented, int(flip.sum()), _is_clean(n_components, labels[is_twisted])


def _bounds(vertices: Floats, faces: Integers) -> tuple[Floats, Floats]:
    corners = vertices[faces.ravel()]
    return corners.min(axis=0), corners.max(axis=0)


def _nesting(
    vertices: Floats,
    faces: Integers,
    labels: Integers,
    closed: NDArray[np.bool_],
    bounds: list[tuple[Floats, Floats]],
) -> tuple[list[int | None], Integers]:
    """Innermost closed component around each component, and how many are around it."""
    n_components = len(bounds)
    low, high = np.array([b[0] for b in bounds]), np.array([b[1] for b in bounds])
    probes = vertices[faces[np.unique(labels, return_index=True)[1], 0]]
    around: list[list[int]] = [[] for _ in range(n_components)]
    for outer in np.flatnonzero(closed):
        candidates = np.flatnonzero(((low[outer] <= low) & (high <= high[outer])).all(axis=1))
        candidates = candidates[candidates != outer]
        if len(candidates):
            is_inside = contains(vertices[faces[labels == outer]], probes[candidates])
            for inner in candidates[is_inside]:
                around[inner].append(int(outer))
    depths = np.array([len(shells) for shells in around], dtype=np.int64)
    parents = [max(shells, key=lambda shell: depths[shell]) if shells else None for shells in around]
    return parents, depths


def _outward(
    vertices: Floats, faces: Integers, labels: Integers, usable: NDArray[np.bool_], depths: Integers
) -> tuple[Integers, int]:
    """Turn closed components out of the solid (shells at odd depth towards their cavity); how many were inward."""
    origin = vertices[faces[0, 0]]  # volumes of closed parts do not depend on it; large offsets would cost digits
    a, b, c = (vertices[faces] - origin).transpose(1, 0, 2)
    volumes = np.bincount(labels, (a * np.cross(b, c)).sum(axis=1), len(depths))
    inward = usable & ((volumes < 0) != (depths % 2 == 1))
    return np.where(inward[labels][:, None], faces[:, ::-1], faces), int(inward.sum())
