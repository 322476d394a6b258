"""A basis of the first homology of a closed oriented surface, by tree–cotree decomposition."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree

from topokit.core.arrays import Floats, Integers
from topokit.core.mesh.connectivity import MeshConnectivity, edge_keys, mesh_connectivity, next_corner

_SHORTEST = 1e-12  # of the longest edge: SciPy takes a length of zero for no edge


@dataclass(frozen=True, eq=False)
class EdgeGraph:
    """The edges of a closed oriented mesh, with directions and lengths.

    Edge e runs from `tails[e]` to `heads[e]`, with face `left[e]` on its left and `right[e]` on its right, seen from
    outside.

    Attributes:
        faces: (F, 3), consistently oriented.
        n_vertices: number of vertices.
        tails, heads: (E,) vertices.
        left, right: (E,) faces.
        lengths: (E,) positive.
    """

    faces: Integers
    n_vertices: int
    tails: Integers
    heads: Integers
    left: Integers
    right: Integers
    lengths: Floats

    @cached_property
    def matrix(self) -> csr_array:
        """Lengths as a symmetric sparse matrix over the vertices."""
        return symmetric(self.tails, self.heads, self.lengths, self.n_vertices)

    @cached_property
    def _keys(self) -> tuple[Integers, Integers]:
        keys = edge_keys(self.tails, self.heads, self.n_vertices)
        order = np.argsort(keys)
        return keys[order], order

    def between(self, first: Integers, second: Integers) -> tuple[Integers, Integers]:
        """The edges (N,) between pairs of neighboring vertices, and 1 or −1 by the direction of each."""
        ordered, order = self._keys
        edges = order[np.searchsorted(ordered, edge_keys(first, second, self.n_vertices))]
        return edges, np.where(self.tails[edges] == first, 1, -1)


@dataclass(frozen=True, eq=False)
class CycleBasis:
    """2·genus loops along edges and as many across edges, dual to each other.

    Loop i runs along edge `crossed[i]` and returns in the spanning tree; dual loop i crosses that edge from right to
    left and returns through faces of the cotree. No other basis loop meets dual loop i, so the class of any closed
    chain c of edges is `c @ crossings`, in terms of the loops.

    Attributes:
        graph: of the edges.
        parents: (V,) the vertex before each in the tree, −1 at the root.
        crossed: (2g,) the edge of each loop that is in neither tree.
        loops: (2g, E) signed edges of each loop.
        crossings: (E, 2g) how often each dual loop crosses each edge from right to left.
    """

    graph: EdgeGraph
    parents: Integers
    crossed: Integers
    loops: csr_array
    crossings: csr_array

    def class_of(self, loop: Integers) -> Integers:
        """Homology class (2g,) of a closed walk along edges, given by its vertices (N,)."""
        edges, signs = self.graph.between(loop, np.roll(loop, -1))
        return np.asarray(signs @ self.crossings[edges]).ravel()

    @cached_property
    def intersections(self) -> Integers:
        """How often basis loop i crosses basis loop j (2g, 2g), signed; determinant 1.

        The dual loops' own numbers are the cup products of their crossings, summed over faces as those of closed forms.
        They are the dual loops' classes, too, because loop i crosses dual loop i once and no other.
        """
        faces = self.graph.faces
        steps = []
        for corner in (0, 1):
            edges, signs = self.graph.between(faces[:, corner], faces[:, corner + 1])
            steps.append(self.crossings[edges].multiply(signs[:, None]).tocsr())
        products = (steps[0].T @ steps[1]).toarray()
        classes = (products - products.T) // 2
        return np.rint(np.linalg.inv(classes.T)).astype(np.int64)


def edge_graph(vertices: Floats, faces: Integers, mesh: MeshConnectivity | None = None) -> EdgeGraph:
    """The edges of a closed mesh.

    Args:
        vertices: (V, 3).
        faces: (F, 3), closed, manifold and consistently oriented.
        mesh: their connectivity, where it is known already.
    """
    left, right = (mesh or mesh_connectivity(faces)).twins
    corners = faces.ravel()
    tails, heads = corners[left], corners[next_corner(left)]
    lengths = np.linalg.norm(vertices[heads] - vertices[tails], axis=1)
    floor = max(_SHORTEST * lengths.max(), np.finfo(float).tiny)
    return EdgeGraph(faces, len(vertices), tails, heads, left // 3, right // 3, np.maximum(lengths, floor))


def cycle_basis(graph: EdgeGraph, root: int = 0) -> CycleBasis:
    """Cut a surface open along a tree of shortest paths and a dual tree of the faces.

    The dual tree prefers edges outside the first tree that close long loops, so that the edges left over
    close short ones: it is the shortest system of loops through the root.

    Args:
        graph: of a connected, closed and oriented mesh in which every vertex is used.
        root: vertex at the root of the first tree.

    Reference:
        Eppstein, Dynamic generators of topologically embedded graphs, SODA 2003; Erickson and Whittlesey, Greedy
        optimal homotopy and homology generators, SODA 2005.
    """
    distances, parents, _ = shortest_paths(graph.matrix, np.array([root]))
    is_tree = (parents[graph.heads] == graph.tails) | (parents[graph.tails] == graph.heads)
    outside = np.flatnonzero(~is_tree)
    loop_lengths = (distances[graph.tails] + graph.lengths + distances[graph.heads])[outside]
    cotree, crossed = _cotree(graph, outside[np.argsort(-loop_lengths, kind="stable")])
    return CycleBasis(graph, parents, crossed, _tree_loops(graph, parents, crossed), _crossings(graph, cotree, crossed))


def shortest_paths(matrix: csr_array, roots: Integers) -> tuple[Floats, Integers, Integers]:
    """Distance from the nearest of the roots, the node before each on the way (−1 at roots), and that root."""
    distances, parents, nearest = dijkstra(matrix, indices=roots, min_only=True, return_predecessors=True)
    return distances, np.maximum(parents.astype(np.int64), -1), nearest.astype(np.int64)


def symmetric(first: Integers, second: Integers, weights: Floats, size: int) -> csr_array:
    """A symmetric sparse matrix from its entries on one side of the diagonal."""
    rows, columns = np.concatenate((first, second)), np.concatenate((second, first))
    return coo_array((np.concatenate((weights, weights)), (rows, columns)), shape=(size, size)).tocsr()


def _cotree(graph: EdgeGraph, candidates: Integers) -> tuple[Integers, Integers]:
    """Edges that a spanning forest of the faces crosses, earlier candidates first, and those left over."""
    n_faces = len(graph.faces)
    ranks = np.arange(1.0, len(candidates) + 1)
    ends = graph.left[candidates], graph.right[candidates]
    forest = minimum_spanning_tree(coo_array((ranks, ends), shape=(n_faces, n_faces)).tocsr())
    is_crossed = np.zeros(len(candidates), dtype=bool)
    is_crossed[forest.data.astype(np.int64) - 1] = True
    return candidates[is_crossed], candidates[~is_crossed]


def _tree_loops(graph: EdgeGraph, parents: Integers, crossed: Integers) -> csr_array:
    """Edge i and the way back from its head to its tail in the tree."""
    rows, edges, signs = [np.arange(len(crossed))], [crossed], [np.ones(len(crossed), dtype=np.int64)]
    for starts, sense in ((graph.heads[crossed], 1), (graph.tails[crossed], -1)):
        for row, child, parent in _climb(parents, starts):
            edge, sign = graph.between(child, parent)
            for found, values in zip((rows, edges, signs), (row, edge, sense * sign), strict=True):
                found.append(values)
    return _summed(rows, edges, signs, (len(crossed), len(graph.tails)))


def _crossings(graph: EdgeGraph, cotree: Integers, crossed: Integers) -> csr_array:
    """Dual loops: across edge i from right to left, and back through the faces of the cotree."""
    n_faces = len(graph.faces)
    left, right = graph.left[cotree], graph.right[cotree]
    _, parents, _ = shortest_paths(symmetric(left, right, np.ones(len(cotree)), n_faces), np.zeros(1, dtype=np.int64))
    is_left_child = parents[left] == right
    edge_above = np.full(n_faces, -1)
    edge_above[np.where(is_left_child, left, right)] = cotree
    rows, columns, signs = [crossed], [np.arange(len(crossed))], [np.ones(len(crossed), dtype=np.int64)]
    for starts, sense in ((graph.left[crossed], 1), (graph.right[crossed], -1)):
        for column, child, parent in _climb(parents, starts):
            edge = edge_above[child]
            sign = np.where(graph.left[edge] == parent, sense, -sense)
            for found, values in zip((rows, columns, signs), (edge, column, sign), strict=True):
                found.append(values)
    return _summed(rows, columns, signs, (len(graph.tails), len(crossed)))


def _climb(parents: Integers, nodes: Integers) -> Iterator[tuple[Integers, Integers, Integers]]:
    """Steps from nodes to their roots, all at once: which of them, child and parent."""
    which = np.arange(len(nodes))
    while len(nodes):
        above = parents[nodes]
        goes_on = above >= 0
        which, nodes, above = which[goes_on], nodes[goes_on], above[goes_on]
        if len(nodes):
            yield which, nodes, above
        nodes = above


def _summed(rows: list[Integers], columns: list[Integers], values: list[Integers], shape: tuple[int, int]) -> csr_array:
    joined = [np.concatenate(part) for part in (values, rows, columns)]
    matrix = coo_array((joined[0], (joined[1], joined[2])), shape=shape).tocsr()
    matrix.eliminate_zeros()
    return matrix
