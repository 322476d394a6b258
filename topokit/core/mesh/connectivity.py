"""How the triangles of a mesh are joined, by their indices alone: edges, fans around vertices, and faults."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from topokit.core.arrays import Booleans, Integers
from topokit.core.labels import connected_labels


@dataclass(frozen=True, eq=False)
class MeshConnectivity:
    """The edges of a triangle mesh and what meets at them.

    Half-edge h = 3 f + i runs along face f from its corner i to its corner i + 1.

    Attributes:
        faces: (F, 3) vertex indices.
        half_edges: (3 F,) half-edges sorted by the undirected edge they lie on.
        starts: (E,) where in `half_edges` each edge begins.
        uses: (E,) number of half-edges on each edge.
    """

    faces: Integers
    half_edges: Integers
    starts: Integers
    uses: Integers

    @property
    def n_vertices(self) -> int:
        """One more than the largest index in use."""
        return int(self.faces.max()) + 1

    @property
    def boundary_edges(self) -> int:
        """Number of edges with one face."""
        return int((self.uses == 1).sum())

    @property
    def nonmanifold_edges(self) -> int:
        """Number of edges with three faces or more."""
        return int((self.uses > 2).sum())

    @property
    def is_manifold(self) -> bool:
        """Every edge has at most two faces and every vertex one fan."""
        return self.nonmanifold_edges == 0 and len(self.pinched) == 0

    @property
    def is_closed(self) -> bool:
        """A closed manifold: every edge has two faces and every vertex one fan."""
        return bool((self.uses == 2).all()) and self.is_manifold

    def some_half_edge(self, chosen: Booleans) -> Integers:
        """One half-edge on each of the chosen edges."""
        return self.half_edges[self.starts[chosen]]

    def ends(self, chosen: Booleans) -> Integers:
        """The two vertices (n, 2) of each of the chosen edges."""
        half, corners = self.some_half_edge(chosen), self.faces.ravel()
        return np.stack((corners[half], corners[next_corner(half)]), axis=1)

    @cached_property
    def twins(self) -> tuple[Integers, Integers]:
        """The two half-edges on every edge that has exactly two."""
        first = self.starts[self.uses == 2]
        return self.half_edges[first], self.half_edges[first + 1]

    @cached_property
    def fans(self) -> Integers:
        """(3 F,) label of the fan of faces that each corner belongs to: corners of one vertex, joined across edges."""
        continues = np.ones(len(self.half_edges), dtype=bool)
        continues[self.starts] = False  # three and more half-edges on one edge form a chain
        after = np.flatnonzero(continues)
        first, second = self.half_edges[after - 1], self.half_edges[after]
        corners = self.faces.ravel()
        alike = corners[first] == corners[second]
        first_end, second_end = next_corner(first), next_corner(second)
        return connected_labels(
            len(corners),
            np.concatenate((first, first_end)),
            np.concatenate((np.where(alike, second, second_end), np.where(alike, second_end, second))),
        )

    @cached_property
    def pinched(self) -> Integers:
        """Vertices whose faces form more than one fan."""
        vertex_of_fan = np.empty(int(self.fans.max()) + 1, dtype=np.int64)
        vertex_of_fan[self.fans] = self.faces.ravel()
        return np.flatnonzero(np.bincount(vertex_of_fan) > 1)


def mesh_connectivity(faces: Integers) -> MeshConnectivity:
    """Sort the half-edges of a mesh by edge.

    Args:
        faces: (F, 3) vertex indices, no repeated index within a face, F ≥ 1.
    """
    corners = faces.ravel()
    ends = np.roll(faces, -1, axis=1).ravel()
    keys = edge_keys(corners, ends, int(faces.max()) + 1)
    order = np.argsort(keys, kind="stable")  # faster than quicksort here: neighboring faces have neighboring keys
    ordered = keys[order]
    starts = np.concatenate(([0], np.flatnonzero(ordered[1:] != ordered[:-1]) + 1))
    return MeshConnectivity(faces, order, starts, np.diff(starts, append=len(order)))


def edge_keys(first: Integers, second: Integers, n_vertices: int) -> Integers:
    """One number for each undirected edge, the same from either end."""
    return np.minimum(first, second) * n_vertices + np.maximum(first, second)


def next_corner(corner: Integers) -> Integers:
    """The next corner around the same face; for half-edges, the corner at which they end."""
    return np.where(corner % 3 == 2, corner - 2, corner + 1)
