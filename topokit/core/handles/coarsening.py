"""A smaller graph with the same loops: cells of nodes, joined by the paths between their centers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import dijkstra

from topokit.core.arrays import Integers
from topokit.core.handles.annotated_graph import AnnotatedGraph, path_to_root


@dataclass(frozen=True, eq=False)
class Coarsening:
    """A graph of cells; every edge stands for a path between two centers.

    Attributes:
        fine: the graph with a node for each vertex.
        coarse: the graph with a node for each cell.
        cells: (n,) cell of every fine node.
        edges: (E,) the fine edge in the middle of each coarse edge.
        parents: (n,) the fine node before each on the shortest path from the center of its cell, negative at centers.
    """

    fine: AnnotatedGraph
    coarse: AnnotatedGraph
    cells: Integers
    edges: Integers
    parents: Integers

    @property
    def is_trivial(self) -> bool:
        """Whether every cell is one node."""
        return self.coarse.n_nodes == self.fine.n_nodes

    def lifted(self, nodes: Integers, edges: Integers) -> Integers:
        """The fine nodes (N,) of a closed walk in the coarse graph; nodes may repeat.

        Args:
            nodes: (m,) of the coarse graph.
            edges: (m,) from each to the next; an edge within a cell is passed from its first end to its second.
        """
        if self.is_trivial:
            return nodes
        walk: list[int] = []
        for node, edge in zip(nodes, edges, strict=True):
            fine_edge = self.edges[edge]
            start, end = int(self.fine.first[fine_edge]), int(self.fine.second[fine_edge])
            if self.cells[start] != node:
                start, end = end, start
            walk += path_to_root(self.parents, start)[::-1] + path_to_root(self.parents, end)[:-1]
        return np.array(walk)


def coarsened(graph: AnnotatedGraph, n_cells: int) -> Coarsening:
    """The cells around evenly drawn nodes; with at least as many cells as nodes the graph stays as it is.

    Of parallel paths between two centers the shortest of each key is kept, so no class of loops is lost, and loops grow
    by about the size of a cell.

    Args:
        graph: connected.
        n_cells: about how many.
    """
    n_nodes = graph.n_nodes
    drawn = np.random.default_rng(0).integers(n_nodes, size=n_cells)
    centers = np.unique(drawn) if n_cells < n_nodes else np.arange(n_nodes)
    distances, parents, nearest = dijkstra(graph.matrix, indices=centers, min_only=True, return_predecessors=True)
    parents, cells = parents.astype(np.int64), np.searchsorted(centers, nearest)
    potentials = graph.potentials(parents)
    first, second = cells[graph.first], cells[graph.second]
    lengths = distances[graph.first] + graph.lengths + distances[graph.second]
    keys = potentials[graph.first] + graph.keys - potentials[graph.second]
    turns = first > second
    first, second = np.where(turns, second, first), np.where(turns, first, second)
    keys = np.where(turns[:, None], -keys, keys)
    kept = np.flatnonzero((first != second) | keys.any(axis=1))
    kept = kept[np.lexsort((lengths[kept], keys[kept, 1], keys[kept, 0], second[kept], first[kept]))]
    rows = np.column_stack((first, second, keys))[kept]
    kept = kept[np.concatenate(([True], (rows[1:] != rows[:-1]).any(axis=1)))]
    coarse = AnnotatedGraph(len(centers), first[kept], second[kept], lengths[kept], keys[kept])
    return Coarsening(graph, coarse, cells, kept, parents)
