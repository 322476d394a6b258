"""Exact topology of triangle meshes by counting: V − E + F, boundary loops, manifoldness, orientation, nesting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.components import CountedComponents
from topokit.core.genus import genus_of
from topokit.core.labels import compact_labels, connected_labels, inverse_order
from topokit.core.mesh.connectivity import MeshConnectivity, mesh_connectivity, next_corner
from topokit.core.mesh.flipped_faces import flipped_faces, turned_over
from topokit.core.mesh.nesting import nesting


@dataclass(frozen=True, eq=False)
class MeshTopology:
    """What counting says about a mesh.

    Attributes:
        euler: V − E + F, unreferenced vertices and degenerate faces left out.
        components: the components, largest area first.
        boundary_loops: closed boundary curves in all, as they are once pinched vertices are taken apart.
        boundary_edges, nonmanifold_edges: edges with one face; with three or more.
        pinched_vertices: vertices whose faces form more than one fan.
        flipped: (F,) faces against the majority's orientation in their component, as given.
        inward_components: closed components whose faces point into the solid as given.
        inverted: (C,) which of these bound no cavity, so that the component is turned inside out.
        is_orientable: whether one consistent orientation exists.
        faces: (F, 3) the faces used, oriented consistently and outward (out of the solid) where that is possible.
        face_labels: (F,) index into `components`.
    """

    euler: int
    components: CountedComponents
    boundary_loops: int
    boundary_edges: int
    nonmanifold_edges: int
    pinched_vertices: int
    flipped: Booleans
    inward_components: int
    inverted: Booleans
    is_orientable: bool
    faces: Integers
    face_labels: Integers

    @property
    def flipped_faces(self) -> int:
        """Number of faces against the majority's orientation in their component."""
        return int(self.flipped.sum())

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
        return self.components.genus

    @property
    def has_area(self) -> bool:
        """Whether any face is more than a line or a point."""
        return bool(self.components.area_shares.any())


def mesh_topology(vertices: Floats, faces: Integers, connectivity: MeshConnectivity | None = None) -> MeshTopology:
    """Count a triangle mesh by its indices (equal coordinates are not merged here).

    Every step is an array operation over faces, edges or components, so the time does not depend on how many
    components the faces make.

    Args:
        vertices: (V, 3).
        faces: (F, 3), indices in range, no repeated index within a face, F ≥ 1.
        connectivity: of these faces, where it is known already.
    """
    mesh = connectivity or mesh_connectivity(faces)
    areas, volumes = _areas_and_volumes(vertices, faces)
    vertex_labels, labels = _component_labels(mesh, areas)
    n_components = int(labels.max()) + 1
    euler, loops = _euler_by_component(mesh, vertex_labels, labels), _boundary_loops(mesh, labels)
    flip, is_twisted = flipped_faces(mesh)
    orientable = _without(n_components, labels[is_twisted])
    manifold = _without(n_components, _edge_labels(mesh, labels, mesh.uses > 2), vertex_labels[mesh.pinched])
    closed = manifold & _without(n_components, _edge_labels(mesh, labels, mesh.uses == 1))
    oriented = turned_over(faces, flip)
    low, high = _bounds(vertices, vertex_labels)
    inside, depths = nesting(vertices, oriented, labels, closed & orientable, low, high)
    inward = _inward(np.where(flip, -volumes, volumes), labels, closed & orientable, depths)
    genera = np.where(manifold & orientable, genus_of(euler, loops), -1)
    shares = np.bincount(labels, areas) / max(areas.sum(), np.finfo(float).tiny)
    return MeshTopology(
        euler=int(euler.sum()),
        components=CountedComponents(euler, genera, loops, low, high, shares, inside, depths),
        boundary_loops=int(loops.sum()),
        boundary_edges=mesh.boundary_edges,
        nonmanifold_edges=mesh.nonmanifold_edges,
        pinched_vertices=len(mesh.pinched),
        flipped=flip,
        inward_components=int(inward.sum()),
        inverted=inward & (depths % 2 == 0),
        is_orientable=bool(orientable.all()),
        faces=turned_over(oriented, inward[labels]),
        face_labels=labels,
    )


def _areas_and_volumes(vertices: Floats, faces: Integers) -> tuple[Floats, Floats]:
    """Twice the areas of the faces and six times the volumes under them, (F,) each, up to a common scale.

    The scale is a power of two, so it costs no digits, and areas of tiny meshes do not vanish.
    """
    exponent = np.frexp(np.abs(vertices[: int(faces.max()) + 1]).max())[1]
    a, b, c = (np.ldexp(vertices[faces[:, corner]], -exponent) for corner in range(3))
    cross = np.cross(b - a, c - a)
    a -= a[0]  # volumes of closed parts do not depend on the origin; large offsets would cost digits
    return np.linalg.norm(cross, axis=1), (a * cross).sum(axis=1)


def _component_labels(mesh: MeshConnectivity, weights: Floats) -> tuple[Integers, Integers]:
    """Components connected by vertices, the heaviest first: labels of the vertices (−1 if unused) and of the faces."""
    a, b, c = mesh.faces.T
    joined = connected_labels(mesh.n_vertices, np.concatenate((a, b)), np.concatenate((b, c)))
    labels = compact_labels(joined[a], mesh.n_vertices)
    labels = inverse_order(np.argsort(-np.bincount(labels, weights), kind="stable"))[labels]
    vertex_labels = np.full(mesh.n_vertices, -1)
    vertex_labels[mesh.faces] = labels[:, None]
    return vertex_labels, labels


def _edge_labels(mesh: MeshConnectivity, labels: Integers, chosen: Booleans) -> Integers:
    """Component of each of the chosen edges."""
    return labels[mesh.some_half_edge(chosen) // 3]


def _euler_by_component(mesh: MeshConnectivity, vertex_labels: Integers, labels: Integers) -> Integers:
    """V − E + F of every component."""
    edge_labels = labels[mesh.half_edges[mesh.starts] // 3]
    return np.bincount(vertex_labels[vertex_labels >= 0]) - np.bincount(edge_labels) + np.bincount(labels)


def _without(n_components: int, *faulty: Integers) -> Booleans:
    """Which components occur in none of the lists."""
    clean = np.ones(n_components, dtype=bool)
    for labels in faulty:
        clean[labels] = False
    return clean


def _boundary_loops(mesh: MeshConnectivity, labels: Integers) -> Integers:
    """Boundary curves per component, as they are once the fans of pinched vertices are taken apart."""
    half = mesh.some_half_edge(mesh.uses == 1)
    n_components = int(labels.max()) + 1
    if len(half) == 0:
        return np.zeros(n_components, dtype=np.int64)
    start, end = mesh.fans[half], mesh.fans[next_corner(half)]
    n_fans = int(mesh.fans.max()) + 1
    curves = connected_labels(n_fans, start, end)[start]
    face_of_curve = np.full(n_fans, -1)
    face_of_curve[curves] = half // 3
    return np.bincount(labels[face_of_curve[face_of_curve >= 0]], minlength=n_components)


def _bounds(vertices: Floats, vertex_labels: Integers) -> tuple[Floats, Floats]:
    """Lowest and highest corner (C, 3) of every component."""
    order = np.argsort(vertex_labels, kind="stable")
    order = order[np.searchsorted(vertex_labels[order], 0) :]  # unused vertices come first
    sizes = np.bincount(vertex_labels[order])
    starts, points = np.cumsum(sizes) - sizes, vertices[order]
    return np.minimum.reduceat(points, starts), np.maximum.reduceat(points, starts)


def _inward(volumes: Floats, labels: Integers, usable: Booleans, depths: Integers) -> Booleans:
    """Closed components whose faces point into the solid (shells at odd depth bound a cavity and point into it)."""
    return usable & ((np.bincount(labels, volumes) < 0) != (depths % 2 == 1))
