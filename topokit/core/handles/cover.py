"""Sheets of a graph on which a key cannot be undone: where loops of one side alone are closed."""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Integers
from topokit.core.handles.annotated_graph import AnnotatedGraph, candidates

_SHEETS = 48  # copies of the graph: a knotted tube may have to be wound about that often, in both directions together


def cover(graph: AnnotatedGraph, root: int, side: int) -> tuple[AnnotatedGraph, Integers]:
    """Copies of a graph, joined so that a walk is closed only if its key of one side is 0.

    Some loops on one side are not made of two shortest paths and an edge, as those on tubes that are knotted: they must
    wind around the tube. In the copies they are.

    Args:
        graph: with keys.
        root: node from which shortest paths decide which edges lead to another copy.
        side: 0 for loops that bound inside, 1 for those that bound outside.

    Returns:
        The graph of nodes copy · n + node, with the root at itself in copy 0, and the edge (E,) of each of its edges.
    """
    found = candidates(graph, root)
    jumps = np.zeros(len(graph.first), dtype=np.int64)
    jumps[found.edges] = found.keys[:, side]
    order = np.argsort(found.lengths, kind="stable")
    sheets = _sheets(jumps[found.edges[order]])
    index = np.argsort(sheets)
    begin, edges, end = [], [], []
    for sheet, key in enumerate(sheets):
        place = np.searchsorted(sheets[index], key + jumps)
        other = index[np.minimum(place, len(sheets) - 1)]
        joined = np.flatnonzero(sheets[other] == key + jumps)
        begin.append(graph.first[joined] + sheet * graph.n_nodes)
        end.append(graph.second[joined] + other[joined] * graph.n_nodes)
        edges.append(joined)
    own = np.concatenate(edges)
    size = len(sheets) * graph.n_nodes
    return AnnotatedGraph(size, np.concatenate(begin), np.concatenate(end), graph.lengths[own], graph.keys[own]), own


def _sheets(jumps: Integers) -> Integers:
    """Keys that can be reached from 0 by adding jumps, those in few steps first; the first is 0."""
    distinct = jumps[np.sort(np.unique(jumps, return_index=True)[1])]
    distinct = distinct[distinct != 0]
    sheets = [0]
    for key in sheets:
        if len(sheets) >= _SHEETS:
            break
        for jump in np.concatenate((distinct, -distinct)).tolist():
            if key + jump not in sheets and len(sheets) < _SHEETS:
                sheets.append(key + jump)
    return np.array(sheets)
