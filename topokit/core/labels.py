"""Connected components of a graph that is given by its edges, and small steps with numbers of things."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from topokit.core.arrays import Integers


def connected_labels(n_nodes: int, first: Integers, second: Integers) -> Integers:
    """Label the connected components of an undirected graph.

    Args:
        n_nodes: number of nodes.
        first: (E,) one end of every edge; repeated edges and loops are allowed.
        second: (E,) the other end.

    Returns:
        (n_nodes,) labels 0 … c−1, numbered by first appearance. Linear in nodes and edges.
    """
    index = np.int32 if n_nodes < np.iinfo(np.int32).max else np.int64  # half the memory traffic where it suffices
    ends = (first.astype(index), second.astype(index))
    graph = coo_array((np.ones(len(first)), ends), shape=(n_nodes, n_nodes))  # SciPy computes in float64 anyway
    return connected_components(graph, directed=False)[1].astype(np.int64)


def compact_labels(labels: Integers, n_labels: int) -> Integers:
    """The same labels renumbered 0 … c−1 in their order, without the numbers that do not occur."""
    occurs = np.zeros(n_labels, dtype=bool)
    occurs[labels] = True
    return (np.cumsum(occurs) - 1)[labels]


def count_distinct(values: Integers) -> int:
    """Number of distinct values (N,), N ≥ 1; sorting them is many times faster than `np.unique`."""
    ordered = np.sort(values)
    return 1 + int(np.count_nonzero(ordered[1:] != ordered[:-1]))


def inverse_order(order: Integers) -> Integers:
    """The place (N,) of each of N things in an order of them (N,)."""
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return place
