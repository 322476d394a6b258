"""What is wrong with a triangle mesh, and where: faults of its edges, vertices, faces and components."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.components import Corner
from topokit.core.labels import connected_labels
from topokit.core.loops import bounds_of
from topokit.core.mesh.connectivity import MeshConnectivity, mesh_connectivity
from topokit.core.mesh.topology import MeshTopology, mesh_topology
from topokit.core.surface import vector_areas
from topokit.errors import MissingDependencyError

DefectKind = Literal[
    "non-manifold edges",
    "pinched vertex",
    "self-intersection",
    "flipped faces",
    "duplicate faces",
    "degenerate faces",
    "inverted component",
    "tiny component",
    "cavity",
]

_FLAT = 1e-10  # area as a share of the longest edge squared up to which a face is degenerate: a height of 2e-10 edges
_TINY = 0.01  # diagonal of a component, as a share of the mesh's, up to which it is tiny


@dataclass(frozen=True, eq=False)
class Defect:
    """One fault of a mesh, at one place: faulty elements that are joined make one defect.

    Attributes:
        kind: what is wrong. A self-intersection and a cavity may be meant; the others rarely are.
        faces: (n,) the faces concerned, as rows of the mesh's faces.
        points: (m, 3) where: the ends of the edges, the vertex, or the corners of the faces.
        bounds: lowest and highest corner of the points' bounding box.
    """

    kind: DefectKind
    faces: Integers
    points: Floats
    bounds: tuple[Corner, Corner]


def mesh_defects(vertices: Floats, faces: Integers, self_intersections: bool = True) -> tuple[Defect, ...]:
    """The faults of a mesh, by kind in the order of `DefectKind`, those with most faces first.

    Args:
        vertices: (V, 3).
        faces: (F, 3) as given, no repeated index within a face.
        self_intersections: whether to look for faces that cross each other, which takes longest.

    Raises:
        MissingDependencyError: if self-intersections are wanted and libigl is not installed.
    """
    mesh = mesh_connectivity(faces)
    found = [*_edges(vertices, mesh), *_pinched(vertices, mesh)]
    if self_intersections:
        pairs = intersecting_faces(vertices, faces)
        found += _patches("self-intersection", vertices, faces, np.unique(pairs), pairs)
    topology = mesh_topology(vertices, faces, mesh)
    no_pairs = np.zeros((0, 2), dtype=np.int64)
    found += _patches("flipped faces", vertices, faces, np.flatnonzero(topology.flipped), no_pairs)
    found += _patches("duplicate faces", vertices, faces, np.flatnonzero(_duplicates(faces)), no_pairs)
    found += _patches("degenerate faces", vertices, faces, np.flatnonzero(_degenerate(vertices, faces)), no_pairs)
    for kind, chosen in _odd_components(topology):
        rows = np.flatnonzero(chosen[topology.face_labels])
        found += _by_label(kind, vertices, faces, rows, topology.face_labels[rows])
    return tuple(found)


def _odd_components(topology: MeshTopology) -> Iterator[tuple[DefectKind, Booleans]]:
    """Which components are inside out, which are tiny, and which bound a cavity."""
    yield "inverted component", topology.inverted
    components = topology.components
    sizes = np.linalg.norm(components.high - components.low, axis=1)
    whole = np.linalg.norm(components.high.max(axis=0) - components.low.min(axis=0))
    yield "tiny component", sizes <= _TINY * whole
    yield "cavity", components.depths % 2 == 1


def _edges(vertices: Floats, mesh: MeshConnectivity) -> Iterator[Defect]:
    """Non-manifold edges, those that share a vertex together."""
    chosen = mesh.uses > 2
    edges = mesh.ends(chosen)
    if len(edges) == 0:
        return
    starts, uses = mesh.starts[chosen], mesh.uses[chosen]
    of_edge = np.repeat(np.arange(len(edges)), uses)
    within = np.arange(uses.sum()) - np.repeat(np.cumsum(uses) - uses, uses)
    face = mesh.half_edges[starts[of_edge] + within] // 3
    labels = connected_labels(mesh.n_vertices, edges[:, 0], edges[:, 1])[edges[:, 0]]
    for own in _groups(labels):
        points = vertices[np.unique(edges[own])]
        yield Defect("non-manifold edges", np.unique(face[np.isin(of_edge, own)]), points, bounds_of(points))


def _pinched(vertices: Floats, mesh: MeshConnectivity) -> Iterator[Defect]:
    """Vertices where separate fans of faces touch."""
    order = np.argsort(mesh.faces, axis=None, kind="stable")
    corners = mesh.faces.ravel()[order]
    for vertex in mesh.pinched:
        first, last = np.searchsorted(corners, (vertex, vertex + 1))
        point = vertices[vertex][None]
        yield Defect("pinched vertex", np.sort(order[first:last] // 3), point, bounds_of(point))


def _duplicates(faces: Integers) -> Booleans:
    """Faces that have all three vertices in common with another one."""
    _, which, counts = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
    return counts[which.ravel()] > 1


def _degenerate(vertices: Floats, faces: Integers) -> Booleans:
    """Faces without area."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    longest = np.maximum.reduce([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))])
    return np.linalg.norm(vector_areas(vertices[faces]), axis=1) <= _FLAT * longest


def _patches(kind: DefectKind, vertices: Floats, faces: Integers, rows: Integers, pairs: Integers) -> list[Defect]:
    """Faulty faces (n,), those that share a vertex or are paired (m, 2) together."""
    own = faces[rows]
    first, second = faces[pairs[:, 0], 0], faces[pairs[:, 1], 0]
    joined = connected_labels(
        len(vertices), np.concatenate((own[:, 0], own[:, 1], first)), np.concatenate((own[:, 1], own[:, 2], second))
    )
    return _by_label(kind, vertices, faces, rows, joined[own[:, 0]])


def _by_label(kind: DefectKind, vertices: Floats, faces: Integers, rows: Integers, labels: Integers) -> list[Defect]:
    """One defect for the faces (n,) of every label (n,)."""
    found = []
    for group in _groups(labels):
        points = vertices[np.unique(faces[rows[group]])]
        found.append(Defect(kind, rows[group], points, bounds_of(points)))
    return found


def _groups(labels: Integers) -> list[Integers]:
    """The places of equal labels, the most frequent first."""
    order = np.argsort(labels, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(labels[order])) + 1) if len(labels) else []
    return sorted(groups, key=lambda group: -len(group))


def intersecting_faces(vertices: Floats, faces: Integers) -> Integers:
    """Pairs of faces without a common edge that meet elsewhere than in a common vertex.

    Args:
        vertices: (V, 3).
        faces: (F, 3).

    Returns:
        (P, 2) rows of `faces`.

    Raises:
        MissingDependencyError: if libigl is not installed.
    """
    try:
        from igl.predicates import find_self_intersections
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            'self-intersections are found by libigl, which is not installed: pip install "topokit[defects]", or pass '
            "self_intersections=False."
        ) from error
    _, pairs, _ = find_self_intersections(np.ascontiguousarray(vertices), np.ascontiguousarray(faces))
    pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
    first, second = faces[pairs[:, 0]], faces[pairs[:, 1]]
    n_common = (first[:, :, None] == second[:, None, :]).sum(axis=(1, 2))
    return pairs[n_common < 2]  # libigl reports neighbors that are not oriented alike, too
