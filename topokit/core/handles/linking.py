"""On which side of a closed surface loops bound, by the linking numbers of loops pushed off it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.spatial.transform import Rotation

from topokit.core.arrays import Floats, Integers
from topokit.core.handles.cycle_basis import CycleBasis, EdgeGraph, cycle_basis
from topokit.core.surface import vector_areas

_PAIRS = 1 << 21  # candidate pairs of segments held at once
_TREES = 4  # trees whose loops are tried before a surface is taken to intersect itself


def decided_basis(vertices: Floats, graph: EdgeGraph) -> tuple[CycleBasis, Integers] | None:
    """A basis of loops and the matrix of the side on which each class bounds; None if that is not defined.

    It is not defined where a surface passes through itself. If it does so in few places only, most loops keep clear of
    them, so loops of several trees are tried.

    Args:
        vertices: (V, 3).
        graph: of a connected closed surface; the inside is where its normals do not point.
    """
    for root in np.linspace(0, len(vertices), _TREES, endpoint=False).astype(np.int64):
        basis = cycle_basis(graph, int(root))
        projector = outside_projector(vertices, basis)
        if projector is not None:
            return basis, projector
    return None


def outside_projector(vertices: Floats, basis: CycleBasis) -> Integers | None:
    """The matrix P with x P = 0 for classes that bound inside and x P = x for classes that bound outside.

    Entry (i, j) is, up to sign, the linking number of basis loop i with dual loop j pushed outward off the surface.
    A loop bounds inside if it links no loop outside. Pushed inward instead, dual loop j links loop j once more and no
    other, which gives P − I, and a loop bounds outside if it links no loop inside. Every class is the sum of one that
    bounds inside and one that bounds outside, so P is a projector. That also checks it: P² = P and a trace equal to
    the genus leave no room for a misjudged crossing.

    Args:
        vertices: (V, 3).
        basis: of a closed surface; the inside is where its normals do not point.

    Returns:
        (2g, 2g), or None if there is no such matrix because the loops meet places where the surface intersects itself.

    Reference:
        Dey, Fan and Wang 2013, DOI 10.1145/2461912.2462017 (linking numbers tell the kinds of loops apart).
    """
    view = Rotation.random(None, np.random.default_rng(0))  # linking numbers are the same in every view
    crossed = crossing_numbers(view.apply(vertices), basis)
    linking = (basis.loops @ crossed @ basis.crossings).toarray()
    return linking if is_projector(linking) else None


def is_projector(matrix: Integers) -> bool:
    """Whether P² = P with half of its size as its trace."""
    return bool(2 * np.trace(matrix) == len(matrix) and (matrix @ matrix == matrix).all())


def crossing_numbers(points: Floats, basis: CycleBasis) -> csr_array:
    """Signed crossings (E, E) of the edges of loops under the arcs of dual loops, seen along z.

    The arc of an edge leads from the center of the face on its right through its midpoint to the center of the face on
    its left, pushed outward by next to nothing. Only edges and arcs that occur in the basis count.

    Args:
        points: (V, 3) vertices in general position to the direction of view.
        basis: of a closed oriented surface.
    """
    graph, size = basis.graph, len(basis.graph.tails)
    edges = np.flatnonzero(np.bincount(basis.loops.indices, minlength=size))
    arcs = np.flatnonzero(np.diff(basis.crossings.indptr))
    centers = points[graph.faces].mean(axis=1)
    middles = (points[graph.tails[arcs]] + points[graph.heads[arcs]]) / 2
    faces = np.concatenate((graph.right[arcs], graph.left[arcs]))
    begin = np.concatenate((centers[graph.right[arcs]], middles))
    end = np.concatenate((middles, centers[graph.left[arcs]]))
    tails, heads = points[graph.tails[edges]], points[graph.heads[edges]]
    found = [_own_crossings(points, graph, np.intersect1d(edges, arcs))]
    for edge, half in _overlapping(tails, heads, begin, end):
        own, face = edges[edge], faces[half]
        apart = (graph.left[own] != face) & (graph.right[own] != face)
        edge, half = edge[apart], half[apart]
        signs = _passes_over(begin[half], end[half], tails[edge], heads[edge])
        passed = np.flatnonzero(signs)
        found.append((edges[edge[passed]], arcs[half[passed] % len(arcs)], -signs[passed]))
    under, over, signs = (np.concatenate(part) for part in zip(*found, strict=True))
    return coo_array((signs, (under, over)), shape=(size, size)).tocsr()


def _own_crossings(points: Floats, graph: EdgeGraph, edges: Integers) -> tuple[Integers, Integers, Integers]:
    """Edges over which their own arcs pass.

    Where both faces are seen from outside, the arc lies above the edge; where both are seen from inside, below. Where
    one hides the other, the arc passes the edge once above and once below if it is convex, and not at all if not.
    """
    left_faces, right_faces = graph.faces[graph.left[edges]], graph.faces[graph.right[edges]]
    is_up = _shadow_area(points[left_faces]) > 0, _shadow_area(points[right_faces]) > 0
    opposite = right_faces.sum(axis=1) - graph.tails[edges] - graph.heads[edges]
    left = points[left_faces]
    is_convex = (vector_areas(left) * (points[opposite] - left[:, 0])).sum(axis=1) < 0
    passing = edges[np.where(is_up[0] == is_up[1], is_up[0], is_convex)]
    return passing, passing, np.ones(len(passing), dtype=np.int64)


def _shadow_area(triangles: Floats) -> Floats:
    a, b, c = (triangles[:, corner, :2] for corner in range(3))
    return _turn(a, b, c)


def _turn(a: Floats, b: Floats, c: Floats) -> Floats:
    """Twice the signed area of triangles in the plane, positive counterclockwise."""
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def _passes_over(begin: Floats, end: Floats, tails: Floats, heads: Floats) -> Integers:
    """1 or −1 where the first segment passes above the second, by the direction, and 0 elsewhere."""
    to_tail, to_head = _turn(begin, end, tails), _turn(begin, end, heads)
    to_begin, to_end = _turn(tails, heads, begin), _turn(tails, heads, end)
    crosses = ((to_tail > 0) != (to_head > 0)) & ((to_begin > 0) != (to_end > 0))
    signs = np.zeros(len(begin), dtype=np.int64)
    some = np.flatnonzero(crosses)
    along_edge = (to_tail / np.where(crosses, to_tail - to_head, 1.0))[some]
    along_arc = (to_begin / np.where(crosses, to_begin - to_end, 1.0))[some]
    height = begin[some, 2] + along_arc * (end[some, 2] - begin[some, 2])
    is_over = height > tails[some, 2] + along_edge * (heads[some, 2] - tails[some, 2])
    signs[some] = np.where(is_over, np.where(to_head[some] > 0, 1, -1), 0)
    return signs


def _overlapping(tails: Floats, heads: Floats, begin: Floats, end: Floats) -> Iterator[tuple[Integers, Integers]]:
    """Pairs of an edge and half an arc whose boxes in the plane overlap, in pieces of bounded size."""
    low, high = np.minimum(tails, heads)[:, :2], np.maximum(tails, heads)[:, :2]
    other_low, other_high = np.minimum(begin, end)[:, :2], np.maximum(begin, end)[:, :2]
    for first, second in _starting_within(low[:, 0], high[:, 0], other_low[:, 0], "left"):
        touches = (low[first, 1] <= other_high[second, 1]) & (other_low[second, 1] <= high[first, 1])
        yield first[touches], second[touches]
    for second, first in _starting_within(other_low[:, 0], other_high[:, 0], low[:, 0], "right"):
        touches = (low[first, 1] <= other_high[second, 1]) & (other_low[second, 1] <= high[first, 1])
        yield first[touches], second[touches]


def _starting_within(
    low: Floats, high: Floats, starts: Floats, side: Literal["left", "right"]
) -> Iterator[tuple[Integers, Integers]]:
    """Pairs (i, j) with starts[j] between low[i] and high[i]; a start equal to low[i] counts if the side is left."""
    order = np.argsort(starts)
    ordered = starts[order]
    first, last = np.searchsorted(ordered, low, side), np.searchsorted(ordered, high, "right")
    counts = np.maximum(last - first, 0)
    reached = np.cumsum(counts)
    begin = 0
    while begin < len(low):
        before = reached[begin] - counts[begin]
        stop = max(begin + 1, int(np.searchsorted(reached, before + _PAIRS, side="right")))
        sizes = counts[begin:stop]
        within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        yield np.repeat(np.arange(begin, stop), sizes), order[np.repeat(first[begin:stop], sizes) + within]
        begin = stop
