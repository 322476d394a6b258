"""Short bases of the loops that bound inside a closed surface and of those that bound outside."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from topokit.core.arrays import Integers
from topokit.core.handles.annotated_graph import (
    AnnotatedGraph,
    Candidates,
    Parents,
    annotated,
    candidates,
    closed_by,
    path_to_root,
)
from topokit.core.handles.coarsening import coarsened
from topokit.core.handles.cover import cover
from topokit.core.handles.cycle_basis import CycleBasis
from topokit.core.handles.integer_lattice import PrimitiveBasis

_CELLS = 20_000  # of the graph on which classes of loops are chosen: a second for a genus of 100
_ROOTS = 3  # per loop of the first basis: places through which shorter loops are looked for
_TIGHTENINGS = 4  # times that a chosen loop is replaced by the shortest through the vertex opposite to its start
_SLACK = 1 + 1e-9  # on lengths that bound a search, for rounding


@dataclass(frozen=True, eq=False)
class SurfaceLoop:
    """A closed walk along edges.

    Attributes:
        vertices: (N,) in order, the first not repeated.
        length: sum of its edges.
        own_class: (2g,) homology class in terms of the basis.
    """

    vertices: Integers
    length: float
    own_class: Integers


@dataclass(frozen=True, eq=False)
class Walk:
    """A loop as the edge that closes it in a tree; `own_edges` names the edges of the graph below, if there is one."""

    graph: AnnotatedGraph
    parents: Parents
    edge: int
    own_edges: Integers | None


def short_loops(basis: CycleBasis, projector: Integers) -> tuple[list[SurfaceLoop], list[SurfaceLoop]]:
    """Loops that form a basis of the classes that bound inside, and of those that bound outside, shortest first.

    Args:
        basis: of the loops of a connected closed surface.
        projector: (2g, 2g) of `outside_projector`.
    """
    search = _Search(basis, projector)
    graph = search.graph
    starts = np.unique(graph.cells[basis.graph.tails[basis.crossed]])
    for root in starts:
        search.look_through(int(root))
    roots = _roots_on(search.chosen(), graph.cells)
    for root in np.setdiff1d(list(roots), starts):
        search.look_through(int(root), roots[root] / 2 * _SLACK)
    for side in (0, 1):
        for root in starts:
            if search.is_complete(side):
                break
            search.look_through_cover(int(root), side)
    inside, outside = search.chosen()
    inside += search.walks_to_complete(inside, 0)
    outside += search.walks_to_complete(outside, 1)
    inside, outside = ([search.tightened(loop) for loop in loops] for loops in (inside, outside))
    return sorted(inside, key=_length), sorted(outside, key=_length)


def _length(loop: SurfaceLoop) -> float:
    return loop.length


def _roots_on(loops: Iterable[list[SurfaceLoop]], cells: Integers) -> dict[int, float]:
    """Some places on each loop, with its length; where loops meet, with that of the longest."""
    roots: dict[int, float] = {}
    for loop in (loop for side in loops for loop in side):
        for part in range(_ROOTS):
            cell = int(cells[loop.vertices[len(loop.vertices) * part // _ROOTS]])
            roots[cell] = max(loop.length, roots.get(cell, 0.0))
    return roots


class _Search:
    """The candidates found so far, by class."""

    def __init__(self, basis: CycleBasis, projector: Integers) -> None:
        self._basis, self._projector = basis, projector
        self.graph = coarsened(annotated(basis, projector), _CELLS)
        self._walks: dict[int, tuple[float, Walk]] = {}  # by twice the key, plus 1 for loops that bound outside
        self._classes: dict[int, Integers] = {}

    def look_through(self, root: int, limit: float = np.inf) -> None:
        """Keep the shortest candidate of every one-sided class through a node of the coarse graph."""
        self._keep(self.graph.coarse, candidates(self.graph.coarse, root, limit), None)

    def look_through_cover(self, root: int, side: int) -> None:
        """The same for loops of one side that are not made of two shortest paths."""
        sheets, edges = cover(self.graph.coarse, root, side)
        self._keep(sheets, candidates(sheets, root), edges)

    def _keep(self, graph: AnnotatedGraph, found: Candidates, own_edges: Integers | None) -> None:
        one_sided = np.flatnonzero((found.keys == 0).any(axis=1))
        one_sided = one_sided[np.argsort(found.lengths[one_sided], kind="stable")]
        keys = found.keys[one_sided]
        names, first = np.unique(2 * np.abs(keys.sum(axis=1)) + (keys[:, 0] != 0), return_index=True)
        rows, parents = one_sided[first], found.parents.astype(np.int32)
        for name, edge, length in zip(names, found.edges[rows], found.lengths[rows], strict=True):
            if length < self._walks.get(int(name), (np.inf,))[0]:
                self._walks[int(name)] = float(length), Walk(graph, parents, int(edge), own_edges)

    def chosen(self) -> tuple[list[SurfaceLoop], list[SurfaceLoop]]:
        """The shortest candidates that extend a basis, inside and outside."""
        size = len(self._projector)
        lattices = PrimitiveBasis(size), PrimitiveBasis(size)
        loops: tuple[list[SurfaceLoop], list[SurfaceLoop]] = ([], [])
        for name, (length, walk) in sorted(self._walks.items(), key=lambda item: (item[1][0], item[0])):
            side = name % 2
            if 2 * lattices[side].count < size:
                own = self._class(name, walk)
                if lattices[side].add(own):
                    loops[side].append(SurfaceLoop(self._lifted(walk), length, own))
        return loops

    def is_complete(self, side: int) -> bool:
        """Whether the candidates suffice for a basis of one side."""
        return 2 * len(self.chosen()[side]) == len(self._projector)

    def walks_to_complete(self, loops: list[SurfaceLoop], side: int) -> list[SurfaceLoop]:
        """Closed walks that complete the basis of one side, put together from loops of the tree through its root.

        They meet themselves, so that no mesh can be cut along them; straightening makes curves of them nonetheless.
        """
        lattice = PrimitiveBasis(len(self._projector))
        for loop in loops:
            lattice.add(loop.own_class)
        classes = self._projector if side else np.eye(len(self._projector), dtype=np.int64) - self._projector
        graph, found = self._basis.graph, []
        for own in classes:
            if 2 * lattice.count < len(classes) and lattice.add(own):
                walk = self._tree_walk(own)
                edges = graph.between(walk, np.roll(walk, -1))[0]
                found.append(SurfaceLoop(walk, float(graph.lengths[edges].sum()), own))
        return found

    def _tree_walk(self, own: Integers) -> Integers:
        """A closed walk of a class, along the loops of the tree one after the other."""
        graph, parents = self._basis.graph, self._basis.parents
        walk: list[int] = []
        for index in np.flatnonzero(own):
            edge = self._basis.crossed[index]
            forth = path_to_root(parents, int(graph.tails[edge]))[::-1]
            loop = forth + path_to_root(parents, int(graph.heads[edge]))[:-1]
            walk += abs(int(own[index])) * (loop if own[index] > 0 else loop[:1] + loop[:0:-1])
        return np.array(walk)

    def _class(self, name: int, walk: Walk) -> Integers:
        """The exact class of the first walk that had this name."""
        if name not in self._classes:
            own = self._basis.class_of(self._lifted(walk))
            is_one_sided = np.array_equal(own @ self._projector, own * (name % 2))
            self._classes[name] = own if is_one_sided else np.zeros_like(own)  # which extends no basis
        return self._classes[name]

    def _lifted(self, walk: Walk) -> Integers:
        nodes, edges = closed_by(walk.graph, walk.parents, walk.edge)
        own = edges if walk.own_edges is None else walk.own_edges[edges]
        return self.graph.lifted(nodes % self.graph.coarse.n_nodes, own)

    def tightened(self, loop: SurfaceLoop) -> SurfaceLoop:
        """The shortest loop of the same class through a vertex of the loop, then through the one opposite to that."""
        fine, edges = self.graph.fine, self._basis.graph
        for _ in range(_TIGHTENINGS):
            root = int(loop.vertices[len(loop.vertices) // 2])
            found = candidates(fine, root, loop.length / 2 * _SLACK)
            passed, signs = edges.between(loop.vertices, np.roll(loop.vertices, -1))
            key = signs @ fine.keys[passed]
            same = np.flatnonzero((found.keys == key).all(axis=1) | (found.keys == -key).all(axis=1))
            if len(same) == 0:
                break
            best = same[np.argmin(found.lengths[same])]
            vertices, passed = closed_by(fine, found.parents, int(found.edges[best]))
            is_shorter = edges.lengths[passed].sum() < loop.length / _SLACK
            loop = SurfaceLoop(vertices, float(edges.lengths[passed].sum()), self._basis.class_of(vertices))
            if not is_shorter:
                break
        return loop
