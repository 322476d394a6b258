"""Short loops around the tunnels in which two solids differ.

The tunnels of a solid that the other one does not have are of two kinds. Some loops bound in the union: the other solid
fills them. Of the rest, those count that no loop of the other solid is homologous to. Random functionals tell them
apart: one word of 64 bits per edge, which adds up along a loop to 0 if the loop bounds, and by chance with probability
2⁻⁶⁴ otherwise. Loops that are taken are checked exactly.

A loop is found by a search in rings around a vertex: the first edge that closes a loop of the kind that is looked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any, Literal

import numpy as np

from topokit.core.arrays import Floats, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.comparison.cells import CRITICAL, FIRST, SECOND, UNION, UPPER, Cells
from topokit.core.comparison.gf2 import Span, Words, kernel
from topokit.core.comparison.reduction import Times, sides_of
from topokit.core.comparison.tunnels import TunnelComplex

Keys = tuple[Words, Words]  # of critical cells and of pairs
Kind = Literal["filled", "absent"]
"""What the other solid does with a tunnel: it fills it, or has no loop like it."""

_REACHES = (1 << 10, 1 << 13, 1 << 16, 1 << 19)  # vertices that a search may see: short loops are found first, and fast
_SHORTENINGS = 4  # times that a loop is looked for again from other vertices of it


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
        most: number of loops.
    """
    boundaries, filled, cycles = found.boundaries(solid), found.boundaries(UNION), found.cycles(solid)
    common = filled.copy()
    for cycle in found.cycles(FIRST + SECOND - solid):
        common.add(cycle)
    bounding, matched = kernel(cycles, cycles, filled), Span(kernel(cycles, cycles, common))
    search = _Search(found, solid)
    goals: tuple[tuple[Kind, list[int], Span, Span | None], ...] = (
        ("filled", bounding, boundaries, filled),
        ("absent", cycles, matched, None),
    )
    for kind, classes, trivial, within in goals:
        for loop in islice(search.loops(classes, trivial, within), most):
            yield TunnelLoop(kind, found.positions(loop))


class _Search:
    """The graph of the vertices and edges of one solid."""

    def __init__(self, found: TunnelComplex, solid: int) -> None:
        self._found, self._solid, self._reduction = found, solid, found.reduction
        self._seen = np.full([(n + 1) // 2 for n in found.shape], -1, np.int32)
        self._random = np.random.default_rng(0)

    def loops(self, classes: list[int], trivial: Span, within: Span | None) -> Iterator[Integers]:
        """Loops (N,) of vertices, independent modulo a span.

        Args:
            classes: which the loops are to generate, modulo the span.
            trivial: classes of loops that do not count; a subspace of that of `classes`.
            within: where the classes of loops have to lie, if not anywhere.
        """
        chosen, inner = trivial.copy(), self._keys(Span() if within is None else within, is_zero=within is None)
        for reach in _REACHES:
            n_before = -1
            while n_before < len(chosen):  # once more with functionals that vanish on the loops found
                outer, n_before = self._keys(chosen), len(chosen)
                for root in self._roots(classes, chosen):
                    loop = self._shortened(root, outer, inner, reach)
                    if len(loop):
                        own = self._found.class_of((loop + np.roll(loop, -1)) // 2)
                        if (within is None or not within.reduced(own)) and chosen.add(own):
                            yield loop

    def _keys(self, vanishing: Span, is_zero: bool = False) -> Keys:
        """Random functionals that vanish on a span, at critical cells and at pairs; or only zeros."""
        known = self._reduction
        critical, pairs = np.zeros(len(known.critical), np.uint64), np.zeros(len(known.uppers), np.uint64)
        if not is_zero:
            critical[self._found.edge_rows] = vanishing.annihilators(self._found.n_edges, self._random)
            add_keys(known.cells, known.steps, known.times, known.uppers, critical, pairs)
        return critical, pairs

    def _roots(self, classes: list[int], chosen: Span) -> list[int]:
        """An end of a critical edge of each class that is not chosen yet."""
        known, found = self._reduction, self._found
        rests = sorted({rest.bit_length() - 1 for own in classes if (rest := chosen.reduced(own))})
        edges = known.critical[found.edge_rows[rests]]
        return (edges - known.steps[_AXES[known.cells[edges] >> 2 & 7]]).tolist()

    def _shortened(self, root: int, outer: Keys, inner: Keys, reach: int) -> Integers:
        """A loop near a root, after it was looked for again from its own vertices while that made it shorter."""
        best = self._loop(root, outer, inner, reach)
        for _ in range(_SHORTENINGS):
            tried = [self._loop(int(best[len(best) * k // 4]), outer, inner, reach) for k in range(4) if len(best)]
            shortest = min((loop for loop in tried if len(loop)), key=len, default=best)
            if len(shortest) >= len(best):
                break
            best = shortest
        return best

    def _loop(self, root: int, outer: Keys, inner: Keys, reach: int) -> Integers:
        known = self._reduction
        shape = np.array(self._found.shape)
        where = known.cells, known.steps, known.times, shape, self._solid, root
        return search_loop(*where, outer, inner, reach, self._seen)


_AXES = np.array([0, 0, 1, 0, 2, 0, 0, 0])
"""Of an edge, by its extents."""


@compiled
def add_keys(cells: Cells, steps: Integers, times: Times, uppers: Integers, critical: Words, pairs: Words) -> None:
    """Write the keys of pairs of an edge and a square, from those of critical cells."""
    for time in range(len(uppers)):
        if cells[uppers[time]] >> 2 & 7 not in (1, 2, 4):  # a square
            key = np.uint64(0)
            for edge in sides_of(cells, steps, uppers[time]):
                if cells[edge] & (CRITICAL | UPPER) or times[edge] != time:
                    key ^= _key(cells, times, edge, critical, pairs)
            pairs[time] = key


@compiled
def _key(cells: Cells, times: Times, edge: int, critical: Words, pairs: Words) -> Any:
    if cells[edge] & UPPER:
        return np.uint64(0)
    return critical[times[edge]] if cells[edge] & CRITICAL else pairs[times[edge]]


@compiled
def search_loop(
    cells: Cells,
    steps: Integers,
    times: Times,
    shape: Integers,
    solid: int,
    root: int,
    outer: Keys,
    inner: Keys,
    reach: int,
    seen: Times,
) -> Integers:
    """Vertices of a loop near a root whose outer keys add up to something and whose inner keys to 0; none if empty.

    Args:
        cells: flat, after they were removed.
        steps: as in `Reduction`.
        times: likewise.
        shape: (3,) of the cells.
        solid: `FIRST` or `SECOND`, in which the loop is.
        root: where the search begins.
        outer: keys of critical cells and of pairs.
        inner: likewise.
        reach: vertices that are seen, at most about.
        seen: −1 for each vertex, before and after.
    """
    capacity, n_seen, at, end = 1024, 1, 0, -1
    vertices, parents = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    sums = np.empty((capacity, 2), np.uint64)
    vertices[0], parents[0], sums[0] = root, -1, 0
    seen[_place(root, shape)] = 0
    while at < n_seen < reach and end < 0:
        for direction in range(6):
            step = steps[direction >> 1] * (1 if direction & 1 else -1)
            vertex, edge = vertices[at] + 2 * step, vertices[at] + step
            if cells[edge] == 0 or (cells[edge] & 3 != 0 and cells[edge] & 3 != solid):
                continue
            one = sums[at, 0] ^ _key(cells, times, edge, outer[0], outer[1])
            other = sums[at, 1] ^ _key(cells, times, edge, inner[0], inner[1])
            known = seen[_place(vertex, shape)]
            if known >= 0:
                if one != sums[known, 0] and other == sums[known, 1]:
                    end = known
                    break
                continue
            if n_seen == capacity:
                vertices, parents = np.concatenate((vertices, vertices)), np.concatenate((parents, parents))
                sums = np.concatenate((sums, sums))
                capacity *= 2
            seen[_place(vertex, shape)] = n_seen
            vertices[n_seen], parents[n_seen], sums[n_seen, 0], sums[n_seen, 1] = vertex, at, one, other
            n_seen += 1
        at += end < 0
    for k in range(n_seen):
        seen[_place(vertices[k], shape)] = -1
    return _closed(vertices, parents, at, end) if end >= 0 else vertices[:0].copy()


@compiled
def _closed(vertices: Integers, parents: Integers, one: int, other: int) -> Integers:
    """The loop from a vertex up to where the ways of both from the root part, and down to the other one."""
    first, second = [one], [other]
    while first[-1] != second[-1]:  # numbers grow along a way
        if first[-1] > second[-1]:
            first.append(parents[first[-1]])
        else:
            second.append(parents[second[-1]])
    return np.concatenate((vertices[np.array(first)], vertices[np.array(second[:-1][::-1])]))


@compiled
def _place(vertex: int, shape: Integers) -> tuple[int, int, int]:
    """Where a vertex is in an array of vertices."""
    x, y, z = vertex // (shape[1] * shape[2]), vertex // shape[2] % shape[1], vertex % shape[2]
    return x >> 1, y >> 1, z >> 1
