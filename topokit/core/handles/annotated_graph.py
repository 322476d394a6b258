"""Graphs whose edges know what they contribute to the homology class of a loop, and short loops in them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from topokit.core.arrays import Floats, Integers
from topokit.core.handles.cycle_basis import CycleBasis, symmetric
from topokit.core.mesh.connectivity import edge_keys

Parents = NDArray[np.signedinteger]  # of 32 or 64 bits

_KEY_BITS = 40  # of random numbers: two classes share a key with a chance of 2⁻⁴⁰, and chosen loops are checked exactly


@dataclass(frozen=True, eq=False)
class AnnotatedGraph:
    """An undirected graph with keys that add up along walks.

    The keys of a closed walk are two numbers that depend on its homology class alone: the first is 0 where the class
    bounds inside, the second where it bounds outside. Up to chance, nothing else makes them 0 or equal.

    Attributes:
        n_nodes: number of nodes.
        first, second: (E,) ends of the edges; parallel edges and edges from a node to itself are allowed.
        lengths: (E,) positive.
        keys: (E, 2) from `first` to `second`.
    """

    n_nodes: int
    first: Integers
    second: Integers
    lengths: Floats
    keys: Integers

    @cached_property
    def _sorted_pairs(self) -> tuple[Integers, Integers]:
        """Codes of the pairs of distinct nodes that have an edge, sorted, and the shortest edge of each."""
        codes = edge_keys(self.first, self.second, self.n_nodes)
        order = np.lexsort((self.lengths, codes))
        order = order[self.first[order] != self.second[order]]
        is_new = np.concatenate(([True], np.diff(codes[order]) > 0))
        return codes[order][is_new], order[is_new]

    @cached_property
    def matrix(self) -> csr_array:
        """Lengths as a symmetric sparse matrix, the shortest of parallel edges."""
        shortest = self._sorted_pairs[1]
        return symmetric(self.first[shortest], self.second[shortest], self.lengths[shortest], self.n_nodes)

    def between(self, start: Integers, end: Integers) -> tuple[Integers, Integers]:
        """The shortest edge (N,) between neighboring nodes, and 1 or −1 by its direction."""
        codes, edges = self._sorted_pairs
        found = edges[np.searchsorted(codes, edge_keys(start, end, self.n_nodes))]
        return found, np.where(self.first[found] == start, 1, -1)

    def potentials(self, parents: Integers) -> Integers:
        """Keys (n, 2) of the paths from the roots of a forest to its nodes, by doubling the steps.

        Args:
            parents: (n,) the node before each, negative at roots and nodes out of reach.
        """
        steps = np.flatnonzero(parents >= 0)
        edges, signs = self.between(parents[steps], steps)
        keys = np.zeros((len(steps) + 1, 2), dtype=np.int64)  # the last row stands for the roots
        keys[:-1] = self.keys[edges] * signs[:, None]
        row = np.full(len(parents), len(steps))
        row[steps] = np.arange(len(steps))
        above = np.append(row[parents[steps]], len(steps))
        while (above < len(steps)).any():
            keys += keys[above]
            above = above[above]
        all_keys = np.zeros((len(parents), 2), dtype=np.int64)
        all_keys[steps] = keys[:-1]
        return all_keys


@dataclass(frozen=True, eq=False)
class Candidates:
    """Loops through a root: to one end of an edge by a shortest path, along the edge, and back by another.

    Attributes:
        parents: (n,) the node before each on its shortest path from the root.
        edges: (m,) the edge of each loop.
        lengths: (m,)
        keys: (m, 2)
    """

    parents: Integers
    edges: Integers
    lengths: Floats
    keys: Integers


def annotated(basis: CycleBasis, projector: Integers) -> AnnotatedGraph:
    """The edges of the mesh with keys by the side on which loops bound.

    Args:
        basis: of loops.
        projector: (2g, 2g) of `outside_projector`.
    """
    generator = np.random.default_rng(0)
    random = generator.integers(-(1 << _KEY_BITS), 1 << _KEY_BITS, size=(len(projector), 2))
    weights = np.stack((projector @ random[:, 0], random[:, 1] - projector @ random[:, 1]), axis=1)
    graph = basis.graph
    keys = np.asarray(basis.crossings @ weights)
    return AnnotatedGraph(graph.n_vertices, graph.tails, graph.heads, graph.lengths, keys)


def candidates(graph: AnnotatedGraph, root: int, limit: float = np.inf) -> Candidates:
    """The loops through a root that no shortcut makes trivial, one per edge outside the tree of shortest paths.

    Args:
        graph: with keys.
        root: a node.
        limit: only nodes within this distance are searched.

    Reference:
        Erickson and Whittlesey, Greedy optimal homotopy and homology generators, SODA 2005.
    """
    distances, parents = dijkstra(graph.matrix, indices=root, limit=limit, return_predecessors=True)
    potentials = graph.potentials(parents.astype(np.int64))
    near = np.flatnonzero(np.isfinite(distances[graph.first]) & np.isfinite(distances[graph.second]))
    first, second = graph.first[near], graph.second[near]
    keys = potentials[first] + graph.keys[near] - potentials[second]
    some = np.flatnonzero(keys.any(axis=1))
    lengths = (distances[first] + graph.lengths[near] + distances[second])[some]
    return Candidates(parents, near[some], lengths, keys[some])


def closed_by(graph: AnnotatedGraph, parents: Parents, edge: int) -> tuple[Integers, Integers]:
    """The loop that an edge closes in a tree: its nodes (N,), and the edge from each to the next.

    Args:
        graph: of the edge.
        parents: (n,) the node before each, negative at the root.
        edge: index.
    """
    forth, back = path_to_root(parents, int(graph.first[edge])), path_to_root(parents, int(graph.second[edge]))
    while len(forth) > 1 and len(back) > 1 and forth[-2] == back[-2]:
        forth.pop()
        back.pop()
    nodes = np.array(forth[::-1] + back[:-1])
    edges = np.full(len(nodes), edge)
    steps = np.flatnonzero(np.arange(len(nodes)) != len(forth) - 1)
    edges[steps] = graph.between(nodes[steps], np.roll(nodes, -1)[steps])[0]
    return nodes, edges


def path_to_root(parents: Parents, node: int) -> list[int]:
    """Nodes from one of a tree to its root."""
    path = [node]
    while (above := int(parents[path[-1]])) >= 0:
        path.append(above)
    return path
