"""A small complex with the homology of all cells, for the whole and for each solid: discrete Morse theory.

Cells are removed in pairs, a cell with the only one of its faces that is left; where there is no such pair, a cell
without faces left is removed alone. It is critical. Pairs are of one rank, so every rank has its own small complex of
critical cells, and inclusions of ranks are inclusions of critical cells. The boundary of a critical cell is found by
sliding its faces down the pairs.

References:
    M. Mrozek, B. Batko, "Coreduction homology algorithm", Discrete & Computational Geometry 41, 2009,
    doi:10.1007/s00454-008-9073-y.
    K. Mischaikow, V. Nanda, "Morse theory for filtrations and efficient computation of persistent homology", Discrete
    & Computational Geometry 50, 2013, doi:10.1007/s00454-013-9529-6.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.comparison.cells import CRITICAL, EXTENT, PRESENT, UPPER, Cells

Times = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Reduction:
    """Cells after all of them were removed.

    Attributes:
        cells: (M,) with their states; flat.
        steps: (3,) from a cell to the next one along each axis.
        times: (M,) of a vertex or edge that is a lower cell of a pair: the number of the pair; of a critical cell: its
            row in `critical`.
        uppers: (P,) the upper cell of each pair of a vertex and an edge or an edge and a square, in order of removal.
        critical: (C,) flat indices of critical cells.
    """

    cells: Cells
    steps: Integers
    times: Times
    uppers: Integers
    critical: Integers

    @property
    def ranks(self) -> Integers:
        """(C,) ranks of the critical cells."""
        return (self.cells[self.critical] & 3).astype(np.int64)

    @property
    def dimensions(self) -> Integers:
        """(C,) dimensions of the critical cells."""
        return _DIMENSIONS[self.cells[self.critical] >> 2 & 7]

    def ends(self, rows: Integers) -> Integers:
        """Rows in `critical` (N, 2) of the vertices to which the ends of critical edges (N,) slide."""
        found = np.empty((len(rows), 2), np.int64)
        slide_ends(self.cells, self.steps, self.times, self.uppers, self.critical[rows], found)
        return found

    def slid(self, edges: Integers) -> list[int]:
        """Rows in `critical` of the edges to which some edges (N,) slide, those that occur oddly."""
        slid = slide_edges(self.cells, self.steps, self.times, self.uppers, edges)
        rows, counts = np.unique(slid, return_counts=True)
        return rows[counts % 2 == 1].tolist()


_DIMENSIONS = np.array([0, 1, 1, 2, 1, 2, 2, 3])


def reduced(cells: Cells) -> Reduction:
    """Remove all cells, which are changed in place.

    Args:
        cells: of `labeled_cells`.
    """
    _, n_y, n_z = cells.shape
    steps, flat = np.array([n_y * n_z, n_z, 1]), cells.reshape(-1)
    times = np.zeros(flat.size, np.int32)
    uppers = np.empty(np.count_nonzero(flat) // 2 + 1, np.int64)
    n_pairs, critical = remove_cells(flat, steps, times, uppers)
    return Reduction(flat, steps, times, uppers[:n_pairs].copy(), critical)


@compiled
def remove_cells(cells: Cells, steps: Integers, times: Times, uppers: Integers) -> tuple[int, Integers]:
    """Remove all cells in pairs or alone; arguments as in `Reduction`, which are written.

    Returns:
        The number of pairs that were written, and the critical cells.
    """
    queue, head, tail = np.empty(1024, np.int64), 0, 0
    critical, n_critical, n_pairs = np.empty(1024, np.int64), 0, 0
    for kind in range(16):  # ranks in turn, in each all vertices before all edges and so on
        for start in range(cells.size):
            code = cells[start]
            if not code & PRESENT or code & 3 != kind >> 2 or _dimension(code) != kind & 3:
                continue
            if n_critical == len(critical):
                critical = np.concatenate((critical, np.empty(n_critical, np.int64)))
            critical[n_critical], times[start] = start, n_critical
            n_critical += 1
            cells[start] ^= PRESENT | CRITICAL
            queue, head, tail = _push_cofaces(cells, steps, start, queue, head, tail)
            while head < tail:
                upper = queue[head & (len(queue) - 1)]
                head += 1
                lower = _only_face(cells, steps, upper)
                if lower < 0 or cells[lower] & 3 != cells[upper] & 3:
                    continue
                cells[lower] ^= PRESENT
                cells[upper] ^= PRESENT | UPPER
                if _dimension(cells[upper]) < 3:
                    times[lower], uppers[n_pairs] = n_pairs, upper
                    n_pairs += 1
                queue, head, tail = _push_cofaces(cells, steps, lower, queue, head, tail)
                queue, head, tail = _push_cofaces(cells, steps, upper, queue, head, tail)
    return n_pairs, critical[:n_critical].copy()


@compiled
def slide_ends(cells: Cells, steps: Integers, times: Times, uppers: Integers, edges: Integers, found: Integers) -> None:
    """Write the rows (N, 2) of the critical vertices to which the ends of edges (N,) slide."""
    for row in range(len(edges)):
        step = steps[_axis(cells[edges[row]])]
        for side in range(2):
            vertex = edges[row] + (step if side else -step)
            while not cells[vertex] & CRITICAL:
                vertex = 2 * uppers[times[vertex]] - vertex
            found[row, side] = times[vertex]


@compiled
def slide_edges(cells: Cells, steps: Integers, times: Times, uppers: Integers, edges: Integers) -> Integers:
    """The rows of the critical edges to which edges slide, with repetition."""
    found, n_found = np.empty(64, np.int64), 0
    waiting = [0 for _ in range(0)]
    for edge in edges:
        n_found, found = _slide(cells, times, edge, waiting, n_found, found)
    while waiting:  # pairs from the last removed on, so that all ways into a pair are known before it is left
        time = heapq.heappop(waiting)
        is_odd = True
        while waiting and waiting[0] == time:
            heapq.heappop(waiting)
            is_odd = not is_odd
        if is_odd:
            for edge in sides_of(cells, steps, uppers[-time]):
                if cells[edge] & (CRITICAL | UPPER) or times[edge] != -time:
                    n_found, found = _slide(cells, times, edge, waiting, n_found, found)
    return found[:n_found].copy()


@compiled
def sides_of(cells: Cells, steps: Integers, square: int) -> Integers:
    """The four sides of a square."""
    sides, n_sides = np.empty(4, np.int64), 0
    for axis in range(3):
        if cells[square] & EXTENT << axis:
            sides[n_sides], sides[n_sides + 1] = square - steps[axis], square + steps[axis]
            n_sides += 2
    return sides


@compiled
def _slide(
    cells: Cells, times: Times, edge: int, waiting: list[int], n_found: int, found: Integers
) -> tuple[int, Integers]:
    if cells[edge] & CRITICAL:
        if n_found == len(found):
            found = np.concatenate((found, np.empty(n_found, np.int64)))
        found[n_found] = times[edge]
        n_found += 1
    elif not cells[edge] & UPPER:
        heapq.heappush(waiting, -int(times[edge]))
    return n_found, found


@compiled
def _only_face(cells: Cells, steps: Integers, cell: int) -> int:
    """The only face of a cell that is left; −1 if there is none or more than one, or the cell is gone."""
    code, only = cells[cell], -1
    if not code & PRESENT:
        return -1
    for axis in range(3):
        if code & EXTENT << axis:
            for face in (cell - steps[axis], cell + steps[axis]):
                if cells[face] & PRESENT:
                    if only >= 0:
                        return -1
                    only = face
    return only


@compiled
def _push_cofaces(
    cells: Cells, steps: Integers, cell: int, queue: Integers, head: int, tail: int
) -> tuple[Integers, int, int]:
    """Put the cells around a removed one that have one face left at the end of a circular queue."""
    for axis in range(3):
        if not cells[cell] & EXTENT << axis:
            for coface in (cell - steps[axis], cell + steps[axis]):
                if _only_face(cells, steps, coface) >= 0:
                    if tail - head == len(queue):
                        at = head & (len(queue) - 1)
                        queue = np.concatenate((queue[at:], queue[:at], np.empty(len(queue), np.int64)))
                        head, tail = 0, tail - head
                    queue[tail & (len(queue) - 1)] = coface
                    tail += 1
    return queue, head, tail


@compiled
def _dimension(code: int) -> int:
    return (code >> 2 & 1) + (code >> 3 & 1) + (code >> 4 & 1)


@compiled
def _axis(code: int) -> int:
    """The axis along which an edge extends."""
    return (code >> 3 & 1) + 2 * (code >> 4 & 1)
