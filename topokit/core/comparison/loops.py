"""Short loops around the tunnels in which two solids differ.

The tunnels of a solid that the other one does not have are of two kinds. Some loops bound in the union: the other solid
fills them. Of the rest, those count that no loop of the other solid is homologous to. Random functionals tell them
apart: every edge has a key of some words, which adds up along a loop to 0 if the loop bounds, and by chance with
probability 2⁻⁶⁴ otherwise. Loops that are taken are checked exactly.

Loops are found in the graph of clusters, short ones first and many at a time. Each is then looked for again among the
vertices of the clusters that it passes.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Literal

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.comparison.cells import CRITICAL, FIRST, SECOND, UNION, UPPER
from topokit.core.comparison.clusters import (
    ClusterGraph,
    Clusters,
    FoundLoops,
    KeyedEdges,
    Numbers,
    add_key,
    cluster_graph,
    clustered,
    is_in,
    is_wanted,
    loops_through,
    way_from,
)
from topokit.core.comparison.gf2 import Span, Words, kernel
from topokit.core.comparison.reduction import sides_of
from topokit.core.comparison.tunnels import TunnelComplex

Kind = Literal["filled", "absent"]
"""What the other solid does with a tunnel: it fills it, or has no loop like it."""

_SHORTEST = 64  # length of loops that are looked for first, then of four times that, and so on
_LAST = 100  # roots, at most about twice, near which loops are looked for once more at the end
_APART = 4  # roots are so many times closer to each other than the loops are long
_SHORTENINGS = 4  # times that a loop is looked for again from two other vertices of it


@dataclass(frozen=True, eq=False)
class TunnelLoop:
    """A loop of one solid around a tunnel that the other one does not have.

    Attributes:
        kind: what the other one does.
        vertices: (N, 3) in the order of the loop, in steps of the grid from the center of its first voxel.
    """

    kind: Kind
    vertices: Floats


def differing_loops(found: TunnelComplex, solid: int, most: int) -> Iterator[TunnelLoop]:
    """Loops around the tunnels of one solid that the other one does not have, independent of each other.

    There is one for each such tunnel, but at most `most`, and fewer where a tunnel that is filled has no loop that one
    edge closes in a search.

    Args:
        found: of both solids.
        solid: `FIRST` or `SECOND`.
        most: number of loops of each kind.
    """
    boundaries, filled, cycles = found.boundaries(solid), found.boundaries(UNION), found.cycles(solid)
    common = filled.copy()
    for cycle in found.cycles(FIRST + SECOND - solid):
        common.add(cycle)
    bounding, matched = kernel(cycles, cycles, filled), Span(kernel(cycles, cycles, common))
    goals = [
        _Goal("filled", boundaries, filled, min(most, len(Span(bounding)) - len(boundaries))),
        _Goal("absent", matched, None, min(most, len(cycles) - len(matched))),
    ]
    goals = [goal for goal in goals if goal.n_loops]
    if not goals:
        return
    edges = _keyed_edges(found, solid, [span for goal in goals for span in goal.spans])
    clusters = clustered(edges)
    graph, end = cluster_graph(edges, clusters), 0
    for goal in goals:
        begin, end = end, end + len(goal.spans)
        own, pairs, keys = (
            np.ascontiguousarray(words[:, begin:end]) for words in (edges.critical, edges.pairs, graph.keys)
        )
        search = _Search(found, goal, edges._replace(critical=own, pairs=pairs), clusters, graph._replace(keys=keys))
        for loop in islice(search.loops(), goal.n_loops):
            yield TunnelLoop(goal.kind, found.positions(loop))


@dataclass(frozen=True, eq=False)
class _Goal:
    """Which loops are looked for.

    Attributes:
        kind: of the loops.
        trivial: classes of loops that do not count.
        within: where the classes of loops have to lie, if not anywhere.
        n_loops: how many there are, or how many are wanted.
    """

    kind: Kind
    trivial: Span
    within: Span | None
    n_loops: int

    @property
    def n_outer(self) -> int:
        """Words of a key that tell whether a loop counts: 64 bits to spare, to tell what depends on chosen loops."""
        return 2 + (self.n_loops - 1) // 64

    @property
    def spans(self) -> list[Span]:
        """On which each word of a key vanishes."""
        return [self.trivial] * self.n_outer + ([] if self.within is None else [self.within])


def _keyed_edges(found: TunnelComplex, solid: int, spans: list[Span]) -> KeyedEdges:
    """The edges of a solid, with keys of random functionals that vanish on spans."""
    known, random = found.reduction, np.random.default_rng(0)
    critical = np.zeros((len(known.critical), len(spans)), np.uint64)
    critical[found.edge_rows] = np.stack([span.annihilators(found.n_edges, random) for span in spans], axis=1)
    pairs = np.zeros((len(known.uppers), len(spans)), np.uint64)
    edges = KeyedEdges(known.cells, known.steps, known.times, np.array(found.shape), solid, critical, pairs)
    add_keys(edges, known.uppers)
    return edges


class _Search:
    """Looks for loops of one kind in one solid."""

    def __init__(
        self, found: TunnelComplex, goal: _Goal, edges: KeyedEdges, clusters: Clusters, graph: ClusterGraph
    ) -> None:
        """Begin a search in the edges of a solid and in the graph of its clusters, with the keys of a goal."""
        self._found, self._goal, self._span = found, goal, goal.trivial.copy()
        self._edges, self._clusters, self._graph = edges, clusters, graph
        self._chosen = np.zeros((goal.n_loops, len(goal.spans)), np.uint64)
        self._bits, self._n_chosen = np.zeros(goal.n_loops, np.int64), 0
        self._seen = np.full(len(clusters.vertices), -1, np.int32)
        self._middles = np.flatnonzero(clusters.depths == 0)
        self._is_near = np.zeros(len(self._middles), bool)

    def loops(self) -> Iterator[Integers]:
        """Loops (N,) of vertices, independent modulo the trivial ones, until enough of them were taken."""
        limit, everywhere, is_limited = _SHORTEST, np.arange(len(self._middles)), True
        while is_limited:
            is_limited = yield from self._shorter_than(limit, everywhere, limit // _APART)
            limit *= 4
        yield from self._shorter_than(limit, everywhere[:: 1 + len(everywhere) // _LAST].copy(), -1)

    def _shorter_than(self, limit: int, roots: Integers, apart: int) -> Generator[Integers, None, bool]:
        """Loops up to a length near roots; whether there may be longer ones."""
        n_before, is_limited = -1, False
        while n_before < self._n_chosen:
            n_before = self._n_chosen
            found = loops_through(self._graph, self._goal.n_outer, roots, limit, apart)
            roots, is_limited = np.sort(found.roots), is_limited or found.is_limited
            for row in np.lexsort((found.roots, found.lengths)).tolist():
                loop = self._taken(found, row)
                if len(loop):
                    yield loop
            self._forget(n_before)
        return is_limited

    def _taken(self, found: FoundLoops, row: int) -> Integers:
        """A loop of vertices along one in the graph of clusters, if that does not depend on those chosen before."""
        key = found.keys[row].copy()
        reduce_key(key, self._chosen[: self._n_chosen], self._bits)
        if not is_wanted(key, self._goal.n_outer):
            return np.empty(0, np.int64)
        start = found.stops[row - 1] if row else 0
        passed = np.unique(found.clusters[start : found.stops[row]])
        around = [self._graph.neighbors[self._graph.begins[one] : self._graph.begins[one + 1]] for one in passed]
        near = np.concatenate((passed, *around))
        self._is_near[near] = True
        loop, key = self._shortened(int(self._middles[found.roots[row]]))
        self._is_near[near] = False
        if not len(loop):
            return loop
        vertices = self._clusters.vertices[loop]
        own = self._found.class_of((vertices + np.roll(vertices, -1)) // 2)
        if (self._goal.within is not None and self._goal.within.reduced(own)) or not self._span.add(own):
            return loop[:0]
        word = int(np.flatnonzero(key)[0])
        self._chosen[self._n_chosen] = key
        self._bits[self._n_chosen] = 64 * word + int(key[word]).bit_length() - 1
        self._n_chosen += 1
        return vertices

    def _shortened(self, root: int) -> tuple[Integers, Words]:
        """A loop near a root with its key, after it was looked for again from its own vertices while it got shorter."""
        best, key = self._loop(root, 1 << 60)
        for _ in range(_SHORTENINGS):
            tried = [self._loop(int(best[len(best) * k // 4]), len(best)) for k in (1, 3) if len(best)]
            shorter = min((one for one in tried if len(one[0])), key=lambda one: len(one[0]), default=None)
            if shorter is None:
                break
            best, key = shorter
        return best, key

    def _loop(self, root: int, longest: int) -> tuple[Integers, Words]:
        chosen = self._chosen[: self._n_chosen]
        where = self._edges, self._clusters, self._is_near
        return search_loop(*where, self._goal.n_outer, chosen, self._bits, root, longest, self._seen)

    def _forget(self, n_before: int) -> None:
        """Take the loops that were chosen last off the keys in the graph of clusters."""
        keys = self._graph.keys
        for row in range(n_before, self._n_chosen):
            word, bit = divmod(int(self._bits[row]), 64)
            keys[(keys[:, word] >> np.uint64(bit) & np.uint64(1)) > 0] ^= self._chosen[row]


@compiled
def add_keys(edges: KeyedEdges, uppers: Integers) -> None:
    """Write the keys of pairs of an edge and a square in a solid, from those of critical cells."""
    for time in range(len(uppers)):
        upper = uppers[time]
        if is_in(edges.cells[upper], edges.solid) and edges.cells[upper] >> 2 & 7 not in (1, 2, 4):  # a square
            for edge in sides_of(edges.cells, edges.steps, upper):
                if edges.cells[edge] & (CRITICAL | UPPER) or edges.times[edge] != time:
                    add_key(edges.pairs[time], edges, edge)


@compiled
def reduce_key(key: Words, chosen: Words, bits: Integers) -> None:
    """Take chosen keys (K, W) off a key (W,), each by its own bit."""
    for row in range(len(chosen)):
        if key[bits[row] >> 6] >> np.uint64(bits[row] & 63) & np.uint64(1):
            for k in range(len(key)):
                key[k] ^= chosen[row, k]


@compiled
def search_loop(
    edges: KeyedEdges,
    clusters: Clusters,
    is_near: Booleans,
    n_outer: int,
    chosen: Words,
    bits: Integers,
    root: int,
    longest: int,
    seen: Numbers,
) -> tuple[Integers, Words]:
    """The first loop that a search in rings closes, of wanted key after the chosen ones were taken off, and that key.

    Args:
        edges: of the solid.
        clusters: likewise.
        is_near: (C,) the clusters in which is searched.
        n_outer: as for `is_wanted`.
        chosen: as for `reduce_key`.
        bits: likewise.
        root: the vertex where the search begins; vertices are rows of the clusters'.
        longest: a loop has to be shorter.
        seen: (n,) −1, before and after.
    """
    vertices, parents, depths, at, one, other = [root], [-1], [0], 0, -1, -1
    sums, key = np.zeros((256, len(edges.critical[0])), np.uint64), np.zeros(len(edges.critical[0]), np.uint64)
    seen[root] = 0
    while at < len(vertices) and one < 0 and 2 * depths[at] < longest - 1:
        number = vertices[at]
        for direction in range(6):
            edge, neighbor = way_from(number, direction, edges, clusters)
            if neighbor < 0 or not is_near[clusters.clusters[neighbor]]:
                continue
            key[:] = sums[at]
            add_key(key, edges, edge)
            known = seen[neighbor]
            if known < 0:
                if len(vertices) == len(sums):
                    sums = np.concatenate((sums, sums))
                seen[neighbor], sums[len(vertices)] = len(vertices), key
                vertices.append(neighbor)
                parents.append(at)
                depths.append(depths[at] + 1)
                continue
            key ^= sums[known]
            if key.any() and depths[at] + depths[known] + 1 < longest:
                reduce_key(key, chosen, bits)
                if is_wanted(key, n_outer):
                    one, other = at, known
                    break
        at += 1
    for number in vertices:
        seen[number] = -1
    return _closed(np.array(vertices), np.array(parents), one, other), key


@compiled
def _closed(vertices: Integers, parents: Integers, one: int, other: int) -> Integers:
    """The loop from a vertex up to where the ways of both from the root part, and down to the other one."""
    if one < 0:
        return vertices[:0].copy()
    first, second = [one], [other]
    while first[-1] != second[-1]:  # numbers grow along a way
        if first[-1] > second[-1]:
            first.append(parents[first[-1]])
        else:
            second.append(parents[second[-1]])
    return np.concatenate((vertices[np.array(first)], vertices[np.array(second[:-1][::-1])]))
