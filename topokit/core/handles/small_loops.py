"""Short loops that do not bound on a surface, found near where they are: within a limit, and in linear time.

A random closed 1-form tells loops that bound from those that do not, up to chance: its sum along a loop depends on the
loop's homology class alone. Two paths of shortest lengths from a root to the ends of an edge make a loop with it; the
shortest of those that do not bound is the shortest through the root. Paths longer than half the limit are never
followed.

References:
    J. Erickson, S. Har-Peled, "Optimally cutting a surface into a disk", DCG 31, 2004, doi:10.1007/s00454-003-2948-z.
    I. Guskov, Z. J. Wood, "Topological noise removal", Graphics Interface 2001 (handles from local fronts).
"""

from __future__ import annotations

from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.handles.cycle_basis import EdgeGraph
from topokit.core.labels import connected_labels

_KEY_BITS = 40  # of random numbers: a loop that does not bound has sum 0 with a chance of 2⁻⁴⁰
_APART = 8  # roots are so many times closer to each other than the limit is long
_TIGHTENINGS = 3  # times that a loop is replaced by the shortest through another of its vertices


class SmallLoops(NamedTuple):
    """Loops that do not bound.

    Attributes:
        loops: length and vertices (N,) in order of each, shortest first.
        roots: vertices (R,) through which there are any.
    """

    loops: list[tuple[float, Integers]]
    roots: Integers


def small_loops(graph: EdgeGraph, limit: float, roots: Integers | None = None) -> SmallLoops:
    """Loops shorter than a limit that do not bound: for each place the shortest.

    Args:
        graph: of a closed oriented mesh.
        limit: largest length.
        roots: (R,) vertices near which loops are looked for; None for everywhere.
    """
    keys = closed_form(graph)
    star = _star(graph)
    roots = np.flatnonzero(_cover(*star, graph.lengths, limit / _APART)) if roots is None else roots
    found, own = _loops_through(*star, graph.lengths, keys, roots, limit * (1 + 2 / _APART))
    for turn in range(1, _TIGHTENINGS + 1):
        middles = np.array([loop[len(loop) * turn // (_TIGHTENINGS + 1)] for _, loop in found], dtype=np.int64)
        longest = max((length for length, _ in found), default=0.0) * (1 + 1e-9)
        found = _distinct(found + _loops_through(*star, graph.lengths, keys, np.unique(middles), longest)[0])
    return SmallLoops([one for one in found if one[0] < limit], own)


def _distinct(found: list[tuple[float, Integers]]) -> list[tuple[float, Integers]]:
    """The loops without repetitions, shortest first."""
    once = {tuple(np.sort(loop).tolist()): (length, loop) for length, loop in reversed(found)}
    return sorted(once.values(), key=lambda one: (one[0], one[1].tolist()))


def closed_form(graph: EdgeGraph) -> Integers:
    """A random closed 1-form: a number for each edge (E,), from tail to head, with sum 0 around every face.

    It is 0 on a spanning forest, random on the edges that a spanning forest of the faces leaves over, and on the other
    edges what makes the faces' sums 0, from the leaves of that forest to its roots.
    """
    n_faces, n_edges = len(graph.faces), len(graph.tails)
    is_left_over = ~_forest(graph.tails, graph.heads, np.ones(n_edges, dtype=bool), graph.n_vertices)
    is_dual = _forest(graph.left, graph.right, is_left_over, n_faces)
    free = is_left_over & ~is_dual
    keys = np.zeros(n_edges, dtype=np.int64)
    keys[free] = np.random.default_rng(0).integers(1, 1 << _KEY_BITS, size=int(free.sum()))
    rest = np.zeros(n_faces, dtype=np.int64)
    np.add.at(rest, graph.left[free], keys[free])
    np.subtract.at(rest, graph.right[free], keys[free])
    dual = np.flatnonzero(is_dual)
    labels = connected_labels(n_faces, graph.left[dual], graph.right[dual])
    first = np.unique(labels, return_index=True)[1]
    ends = np.concatenate((graph.left[dual], first)), np.concatenate((graph.right[dual], np.full(len(first), n_faces)))
    forest = coo_array((np.ones(len(ends[0])), ends), shape=(n_faces + 1, n_faces + 1)).tocsr()
    order, parents = breadth_first_order(forest, n_faces, directed=False)
    edge_above = np.full(n_faces, -1)
    is_child = parents[graph.left[dual]] == graph.right[dual]
    edge_above[np.where(is_child, graph.left[dual], graph.right[dual])] = dual
    _balance(keys, rest, order.astype(np.int64), parents.astype(np.int64), edge_above, graph.left)
    return keys


def _forest(first: Integers, second: Integers, chosen: Booleans, n_nodes: int) -> Booleans:
    """Edges (E,) of a spanning forest of the graph of the chosen ones, earlier edges first."""
    rows = np.flatnonzero(chosen)
    low, high = np.minimum(first[rows], second[rows]), np.maximum(first[rows], second[rows])
    once = np.unique(low * n_nodes + high, return_index=True)[1]
    once = once[low[once] != high[once]]
    weights = rows[once] + 1.0
    graph = coo_array((weights, (low[once], high[once])), shape=(n_nodes, n_nodes)).tocsr()
    kept = np.zeros(len(chosen), dtype=bool)
    kept[minimum_spanning_tree(graph).data.astype(np.int64) - 1] = True
    return kept


@compiled
def _balance(
    keys: Integers, rest: Integers, order: Integers, parents: Integers, edge_above: Integers, left: Integers
) -> None:
    for place in range(len(order) - 1, 0, -1):
        face = order[place]
        edge = edge_above[face]
        if edge >= 0:
            keys[edge] = -rest[face] if left[edge] == face else rest[face]
            rest[parents[face]] += rest[face]


def _star(graph: EdgeGraph) -> tuple[Integers, Integers, Integers]:
    """For each vertex where its neighbors begin (V + 1,), the neighbors (2 E,), and the edges to them.

    Edges are numbered from 1 on, negative against their direction.
    """
    ends = np.concatenate((graph.tails, graph.heads))
    numbers = np.arange(1, len(graph.tails) + 1)
    order = np.argsort(ends, kind="stable")
    begins = np.concatenate(([0], np.cumsum(np.bincount(ends, minlength=graph.n_vertices))))
    return begins, np.concatenate((graph.heads, graph.tails))[order], np.concatenate((numbers, -numbers))[order]


@compiled
def _cover(begins: Integers, neighbors: Integers, edges: Integers, lengths: Floats, radius: float) -> Booleans:
    """Which vertices (V,) are chosen so that every other one is within a radius of one of them."""
    nearest = np.full(len(begins) - 1, np.inf)
    chosen = np.zeros(len(nearest), dtype=np.bool_)
    for root in range(len(nearest)):
        if nearest[root] <= radius:
            continue
        chosen[root] = True
        nearest[root] = 0.0
        heap = [(0.0, root)]
        while heap:
            distance, vertex = heappop(heap)
            if distance > nearest[vertex]:
                continue
            for at in range(begins[vertex], begins[vertex + 1]):
                further = distance + lengths[abs(edges[at]) - 1]
                if further <= radius and further < nearest[neighbors[at]]:
                    nearest[neighbors[at]] = further
                    heappush(heap, (further, neighbors[at]))
    return chosen


def _loops_through(
    begins: Integers,
    neighbors: Integers,
    edges: Integers,
    lengths: Floats,
    keys: Integers,
    roots: Integers,
    limit: float,
) -> tuple[list[tuple[float, Integers]], Integers]:
    """The shortest loop through each root that does not bound, if it is shorter than a limit, and those roots."""
    sizes, counts, vertices, own = _search(begins, neighbors, edges, lengths, keys, roots, limit)
    stops = np.cumsum(counts)
    loops = [(float(size), vertices[stop - n : stop]) for size, n, stop in zip(sizes, counts, stops, strict=True)]
    return _distinct(loops), own


@compiled
def _search(
    begins: Integers,
    neighbors: Integers,
    edges: Integers,
    lengths: Floats,
    keys: Integers,
    roots: Integers,
    limit: float,
) -> tuple[Floats, Integers, Integers, Integers]:
    """The lengths of loops (M,), their numbers of vertices (M,), the vertices of all, and their roots (M,)."""
    n_vertices = len(begins) - 1
    distances, potentials = np.full(n_vertices, np.inf), np.zeros(n_vertices, dtype=np.int64)
    parents, settled = np.full(n_vertices, -1), np.zeros(n_vertices, dtype=np.bool_)
    sizes, counts, found = [0.0 for _ in range(0)], [0 for _ in range(0)], [0 for _ in range(0)]
    own = [0 for _ in range(0)]
    for root in roots:
        best, first, second = limit, -1, -1
        distances[root], potentials[root], parents[root] = 0.0, 0, -1
        touched, heap = [root], [(0.0, root)]
        while heap:
            distance, vertex = heappop(heap)
            if 2 * distance >= best:
                break
            if settled[vertex]:
                continue
            settled[vertex] = True
            for at in range(begins[vertex], begins[vertex + 1]):
                other, number = neighbors[at], abs(edges[at]) - 1
                potential = potentials[vertex] + (keys[number] if edges[at] > 0 else -keys[number])
                further = distance + lengths[number]
                if settled[other]:
                    if potentials[other] != potential and further + distances[other] < best:
                        best, first, second = further + distances[other], vertex, other
                elif further < distances[other]:
                    if distances[other] == np.inf:
                        touched.append(other)
                    distances[other], potentials[other], parents[other] = further, potential, vertex
                    heappush(heap, (further, other))
        if first >= 0:
            forth, back = [first], [second]
            while parents[forth[-1]] >= 0:
                forth.append(parents[forth[-1]])
            while parents[back[-1]] >= 0:
                back.append(parents[back[-1]])
            while len(forth) > 1 and len(back) > 1 and forth[-2] == back[-2]:
                forth.pop()
                back.pop()
            for vertex in forth[::-1]:
                found.append(vertex)
            for vertex in back[:-1]:
                found.append(vertex)
            counts.append(len(forth) + len(back) - 1)
            own.append(root)
            sizes.append(best - 2 * distances[forth[-1]])
        for vertex in touched:
            distances[vertex], settled[vertex] = np.inf, False
    return np.array(sizes), np.array(counts), np.array(found), np.array(own)
