"""The vertices and edges of a solid in clusters: a graph of few nodes that has the same loops.

Every cluster is what a search in rings around a vertex reaches first, up to a radius. A node stands for a cluster, and
an edge for an edge of the solid between two clusters, or within one if it closes a loop that does not bound there. Keys
add up along walks in both graphs alike.
"""

from __future__ import annotations

from heapq import heappop, heappush
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.comparison.cells import CRITICAL, UPPER, Cells
from topokit.core.comparison.gf2 import Words
from topokit.core.comparison.reduction import Times

Numbers = NDArray[np.int32]

_RADIUS = 6  # steps from the middle of a cluster to its last vertices


class KeyedEdges(NamedTuple):
    """The edges of one solid with their keys.

    Attributes:
        cells: flat, after they were removed.
        steps: (3,) as in `Reduction`.
        times: likewise.
        shape: (3,) of the cells.
        solid: `FIRST` or `SECOND`.
        critical: (C, W) keys of critical cells.
        pairs: (P, W) keys of pairs.
    """

    cells: Cells
    steps: Integers
    times: Times
    shape: Integers
    solid: int
    critical: Words
    pairs: Words


class Clusters(NamedTuple):
    """The vertices of a solid, those of a cluster one after the other, the middle first.

    Attributes:
        vertices: (n,) flat indices of cells.
        places: (n,) flat indices in an array of all vertices.
        numbers: the row of each of those, −1 for vertices outside.
        strides: (3,) from a place to the next one along each axis.
        clusters: (n,) the cluster of each vertex.
        depths: (n,) steps from its middle.
        sums: (n, W) keys along the way from there.
    """

    vertices: Integers
    places: Integers
    numbers: Numbers
    strides: Integers
    clusters: Numbers
    depths: Numbers
    sums: Words


class ClusterGraph(NamedTuple):
    """The graph of clusters.

    Attributes:
        begins: (C + 1,) where the neighbors of each cluster begin.
        neighbors: (2 E,) clusters.
        edges: (2 E,) the edge to each of them.
        lengths: (E,) of the ways between the middles of two clusters.
        keys: (E, W)
    """

    begins: Integers
    neighbors: Integers
    edges: Integers
    lengths: Integers
    keys: Words


class FoundLoops(NamedTuple):
    """For each root through which there is a loop the shortest one.

    Attributes:
        roots: (M,) clusters.
        lengths: (M,)
        keys: (M, W)
        stops: (M,) where each loop ends in `clusters`.
        clusters: of all loops; some occur twice in one.
        is_limited: whether there may be longer ones through other roots.
    """

    roots: Integers
    lengths: Integers
    keys: Words
    stops: Integers
    clusters: Integers
    is_limited: bool


def cluster_graph(edges: KeyedEdges, clusters: Clusters) -> ClusterGraph:
    """The graph of clusters; of edges between two clusters with one key the shortest."""
    first, second, lengths, keys = joined_clusters(edges, clusters)
    ends, numbers = np.concatenate((first, second)), np.arange(len(first))
    order = np.argsort(ends, kind="stable")
    n_clusters = int(clusters.clusters[-1]) + 1
    begins = np.concatenate(([0], np.cumsum(np.bincount(ends, minlength=n_clusters))))
    return ClusterGraph(
        begins, np.concatenate((second, first))[order], np.concatenate((numbers, numbers))[order], lengths, keys
    )


@compiled
def clustered(edges: KeyedEdges) -> Clusters:
    """The vertices of a solid that has edges, in clusters; those at no edge are left out."""
    cells, shape = edges.cells, edges.shape
    sides = (shape + 1) // 2
    strides, numbers = np.array([sides[1] * sides[2], sides[2], 1]), np.full(sides.prod(), -1, np.int32)
    n_vertices, n_seen, n_clusters = 0, 0, 0
    for cell in range(cells.size):
        if cells[cell] >> 2 & 7 in (1, 2, 4) and is_in(cells[cell], edges.solid):
            for place in _ends(cell, edges, strides)[1]:
                n_vertices += numbers[place] == -1
                numbers[place] = -2
    found = Clusters(
        np.empty(n_vertices, np.int64),
        np.empty(n_vertices, np.int64),
        numbers,
        strides,
        np.empty(n_vertices, np.int32),
        np.zeros(n_vertices, np.int32),
        np.zeros((n_vertices, edges.critical.shape[1]), np.uint64),
    )
    for cell in range(cells.size):
        if cells[cell] >> 2 & 7 in (1, 2, 4) and is_in(cells[cell], edges.solid):
            vertices, places = _ends(cell, edges, strides)
            for end in range(2):
                if numbers[places[end]] < 0:
                    found.vertices[n_seen], found.places[n_seen], numbers[places[end]] = (
                        vertices[end],
                        places[end],
                        n_seen,
                    )
                    n_seen = _grow(edges, found, n_clusters, n_seen)
                    n_clusters += 1
    return found


@compiled
def _ends(edge: int, edges: KeyedEdges, strides: Integers) -> tuple[tuple[int, int], tuple[int, int]]:
    """Both vertices of an edge, and their places."""
    code, shape = edges.cells[edge], edges.shape
    axis = (code >> 3 & 1) + 2 * (code >> 4 & 1)
    low, high = edge - edges.steps[axis], edge + edges.steps[axis]
    x, y, z = low // (shape[1] * shape[2]), low // shape[2] % shape[1], low % shape[2]
    place = (x >> 1) * strides[0] + (y >> 1) * strides[1] + (z >> 1)
    return (low, high), (place, place + strides[axis])


@compiled
def _grow(edges: KeyedEdges, found: Clusters, cluster: int, at: int) -> int:
    """Write a cluster around the vertex of a row, from that row on; return the row after its last one."""
    n_seen = at + 1
    found.clusters[at] = cluster
    while at < n_seen:
        for direction in range(6 if found.depths[at] < _RADIUS else 0):
            sign = 1 if direction & 1 else -1
            edge = found.vertices[at] + sign * edges.steps[direction >> 1]
            place = found.places[at] + sign * found.strides[direction >> 1]
            if is_in(edges.cells[edge], edges.solid) and found.numbers[place] < 0:
                found.vertices[n_seen], found.places[n_seen] = 2 * edge - found.vertices[at], place
                found.clusters[n_seen], found.depths[n_seen] = cluster, found.depths[at] + 1
                found.numbers[place], found.sums[n_seen] = n_seen, found.sums[at]
                add_key(found.sums[n_seen], edges, edge)
                n_seen += 1
        at += 1
    return n_seen


@compiled
def is_in(code: int, solid: int) -> bool:
    """Whether a cell that is no vertex is in a solid."""
    return code != 0 and (code & 3 == 0 or code & 3 == solid)


@compiled
def add_key(total: Words, edges: KeyedEdges, edge: int) -> None:
    """Add the key of an edge to a sum (W,)."""
    code, time = edges.cells[edge], edges.times[edge]
    if code & CRITICAL:
        for k in range(len(total)):
            total[k] ^= edges.critical[time, k]
    elif not code & UPPER:
        for k in range(len(total)):
            total[k] ^= edges.pairs[time, k]


@compiled
def way_from(number: int, direction: int, edges: KeyedEdges, clusters: Clusters) -> tuple[int, Any]:
    """The edge of a solid from a vertex in one of six directions, and the row of its other end; −1 if there is none."""
    sign = 1 if direction & 1 else -1
    edge = clusters.vertices[number] + sign * edges.steps[direction >> 1]
    if not is_in(edges.cells[edge], edges.solid):
        return -1, -1
    return edge, np.int64(clusters.numbers[clusters.places[number] + sign * clusters.strides[direction >> 1]])


@compiled
def joined_clusters(edges: KeyedEdges, clusters: Clusters) -> tuple[Integers, Integers, Integers, Words]:
    """The edges of the graph of clusters: both ends (E,), lengths (E,) and keys (E, W)."""
    n_words, n_found, begin = edges.critical.shape[1], 0, 0
    first, second, lengths = np.empty(1024, np.int64), np.empty(1024, np.int64), np.empty(1024, np.int64)
    keys, key = np.empty((1024, n_words), np.uint64), np.empty(n_words, np.uint64)
    for number in range(len(clusters.vertices)):
        own = clusters.clusters[number]
        if clusters.depths[number] == 0:
            begin = n_found
        for direction in range(6):
            edge, other = way_from(number, direction, edges, clusters)
            if other < 0 or clusters.clusters[other] < own or (clusters.clusters[other] == own and other < number):
                continue
            key[:] = clusters.sums[number] ^ clusters.sums[other]
            add_key(key, edges, edge)
            if clusters.clusters[other] == own and not key.any():
                continue
            length, row = clusters.depths[number] + 1 + clusters.depths[other], begin
            while row < n_found and (second[row] != clusters.clusters[other] or (keys[row] != key).any()):
                row += 1
            if row < n_found:
                lengths[row] = min(lengths[row], length)
                continue
            if n_found == len(first):
                first, second = np.concatenate((first, first)), np.concatenate((second, second))
                lengths, keys = np.concatenate((lengths, lengths)), np.concatenate((keys, keys))
            first[n_found], second[n_found], lengths[n_found] = own, clusters.clusters[other], length
            keys[n_found] = key
            n_found += 1
    return first[:n_found].copy(), second[:n_found].copy(), lengths[:n_found].copy(), keys[:n_found].copy()


@compiled
def is_wanted(key: Words, n_outer: int) -> bool:
    """Whether the outer words of a key, its first ones, are not all 0, while the others are."""
    is_outer = False
    for k in range(len(key)):
        if key[k]:
            if k >= n_outer:
                return False
            is_outer = True
    return is_outer


@compiled
def loops_through(graph: ClusterGraph, n_outer: int, roots: Integers, limit: int, apart: int) -> FoundLoops:
    """The shortest loops through roots whose keys are wanted, if shorter than a limit.

    Args:
        graph: of clusters.
        n_outer: as for `is_wanted`.
        roots: (R,) clusters; one that an earlier one is close to is left out.
        limit: length of loops.
        apart: largest distance that is close.
    """
    n_clusters, n_words = len(graph.begins) - 1, graph.keys.shape[1]
    far = np.int64(1) << 60
    distances, parents = np.full(n_clusters, far), np.full(n_clusters, -1)
    sums, is_close = np.zeros((n_clusters, n_words), np.uint64), np.zeros(n_clusters, np.bool_)
    is_settled, key = np.zeros(n_clusters, np.bool_), np.empty(n_words, np.uint64)
    n_found, found, keys = 0, np.empty((64, 3), np.int64), np.empty((64, n_words), np.uint64)
    members, is_limited = [0 for _ in range(0)], False
    for root in roots:
        if is_close[root]:
            continue
        best, one, other = limit, -1, -1
        distances[root], parents[root], sums[root] = 0, -1, 0
        touched, waiting = [root], [(0, root)]
        while waiting:
            distance, node = heappop(waiting)
            if 2 * distance >= best:
                is_limited |= one < 0
                break
            if is_settled[node]:
                continue
            is_settled[node] = True
            is_close[node] |= distance <= apart
            for at in range(graph.begins[node], graph.begins[node + 1]):
                neighbor, edge = graph.neighbors[at], graph.edges[at]
                further = distance + graph.lengths[edge]
                if is_settled[neighbor]:
                    if further + distances[neighbor] < best:
                        key[:] = sums[node] ^ sums[neighbor] ^ graph.keys[edge]
                        if is_wanted(key, n_outer):
                            best, one, other = further + distances[neighbor], node, neighbor
                            if n_found == len(found):
                                found, keys = np.concatenate((found, found)), np.concatenate((keys, keys))
                            keys[n_found] = key
                elif further < distances[neighbor]:
                    if distances[neighbor] == far:
                        touched.append(neighbor)
                    distances[neighbor], parents[neighbor] = further, node
                    sums[neighbor] = sums[node] ^ graph.keys[edge]
                    heappush(waiting, (further, neighbor))
        if one >= 0:
            for end in (one, other):
                while end >= 0:
                    members.append(end)
                    end = parents[end]
            found[n_found] = root, best, len(members)
            n_found += 1
        for node in touched:
            distances[node], is_settled[node] = far, False
    own = found[:n_found]
    return FoundLoops(
        own[:, 0].copy(), own[:, 1].copy(), keys[:n_found].copy(), own[:, 2].copy(), np.array(members), is_limited
    )
