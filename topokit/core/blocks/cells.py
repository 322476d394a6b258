"""The compiled loops over a labeled volume: its cells, the regions of equal values, and the walls between them.

A cell joins voxels of equal value through faces. The volume has a layer of one more cell around it, number 0.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.blocks.cubes import cube_tables
from topokit.core.blocks.planes import Labels, root_of, unite


class JunctionTables(NamedTuple):
    """Tables with one row for each code of a cube, as in `cubes.CubeTables`.

    Attributes:
        pieces: (256, 4) see there.
        weights: (256, 4) see there, of one piece or of several: each part of the sums belongs to one of them.
        both: (256, 8) weights of a code and of the code of the other corners.
        edges: (256, 4, 2) for each piece a corner of it, and one beside it that is not in the 6-connected phase.
    """

    pieces: NDArray[np.uint8]
    weights: Integers
    both: Integers
    edges: Integers


@cache
def junction_tables() -> JunctionTables:
    """The tables, computed once."""
    pieces, weights, _ = cube_tables()
    edges = np.zeros((256, 4, 2), np.int64)
    for code in range(255):
        for number, piece in enumerate(pieces[code]):
            corners = [corner for corner in range(8) if piece >> corner & 1]
            across = ((c, c ^ bit) for c in corners for bit in (1, 2, 4) if not code >> (c ^ bit) & 1)
            edges[code, number] = next(across, (0, 0))
    return JunctionTables(pieces, weights, np.concatenate((weights, weights[::-1]), axis=1), edges)


@compiled
def join_cells(values: NDArray[Any], cells: NDArray[Any]) -> int:
    """Join voxels to cells, as a forest in which every voxel stands for itself or for one before it.

    Args:
        values: (X, Y, Z).
        cells: (X + 2, Y + 2, Z + 2), zero, where the flat indices of the voxels above them are written.

    Returns:
        How many cells there are.
    """
    n_x, n_y, n_z = values.shape
    flat, n_cells = cells.reshape(-1), 0
    row, layer = n_z + 2, (n_y + 2) * (n_z + 2)
    starts = np.empty((2, n_y, n_z + 1), np.int32)  # of the runs of equal values in each row of two layers; its length
    for x in range(n_x):
        for y in range(n_y):
            own, runs, first = values[x, y], starts[x % 2, y], (x + 1) * layer + (y + 1) * row + 1
            n_cells += _write_runs(own, first, flat, runs)
            if y > 0:
                n_cells -= _join_rows(own, values[x, y - 1], runs, starts[x % 2, y - 1], first, first - row, flat)
            if x > 0:
                n_cells -= _join_rows(own, values[x - 1, y], runs, starts[1 - x % 2, y], first, first - layer, flat)
    return n_cells


@compiled
def _write_runs(values: NDArray[Any], first: int, parents: NDArray[Any], starts: Labels) -> int:
    """Let each voxel of a row stand for the first one of its run, write where runs start, and return their number."""
    n_runs, z, n_z = 0, 0, len(values)
    while z < n_z:
        start, value = z, values[z]
        while z < n_z and values[z] == value:
            parents[first + z] = first + start
            z += 1
        starts[n_runs] = start
        n_runs += 1
    starts[n_runs] = n_z
    return n_runs


@compiled
def _join_rows(
    values: NDArray[Any],
    others: NDArray[Any],
    starts: Labels,
    other_starts: Labels,
    first: int,
    other_first: int,
    parents: NDArray[Any],
) -> int:
    """Join the runs of two rows side by side that have equal values; how often two cells became one."""
    n_joined, one, other, n_z = 0, 0, 0, len(values)
    while starts[one] < n_z and other_starts[other] < n_z:
        a, b = starts[one], other_starts[other]
        if values[a] == others[b]:
            n_joined += _joined(parents, first + a, other_first + b)
        stop, other_stop = starts[one + 1], other_starts[other + 1]
        one += stop <= other_stop
        other += other_stop <= stop
    return n_joined


@compiled
def _joined(parents: NDArray[Any], one: int, other: int) -> bool:
    """Join the trees of two nodes; whether they were two."""
    one, other = root_of(parents, one), root_of(parents, other)
    parents[max(one, other)] = min(one, other)
    return one != other


@compiled
def number_cells(values: NDArray[Any], cells: NDArray[Any], nodes: Integers) -> None:
    """Number cells from 1 on in the order of their first voxels, and write a row of `part.NODE_COLUMNS` for each.

    Args:
        values: (X, Y, Z).
        cells: (X + 2, Y + 2, Z + 2) of `join_cells`, where the numbers are written instead.
        nodes: (N + 1, 8), zero, where the rows are written; that of cell 0 stays as it is.
    """
    n_x, n_y, n_z = values.shape
    flat, n_cells = cells.reshape(-1), 0
    row, layer = n_z + 2, (n_y + 2) * (n_z + 2)
    for x in range(1, n_x + 1):
        for y in range(1, n_y + 1):
            start, z = x * layer + y * row, 1
            while z <= n_z:
                first, value = z, values[x - 1, y - 1, z - 1]
                if flat[start + z] == start + z:
                    n_cells += 1
                    cell = n_cells
                    node = nodes[cell]
                    node[1], node[2], node[3], node[4] = start + z, x, y, z
                else:
                    cell = flat[flat[start + z]]  # what stands before it has its number already
                    node = nodes[cell]
                while z <= n_z and values[x - 1, y - 1, z - 1] == value:
                    flat[start + z] = cell
                    z += 1
                node[0] += z - first
                node[3], node[4] = min(node[3], y), min(node[4], first)
                node[5], node[6], node[7] = x + 1, max(node[6], y + 1), max(node[7], z)


@compiled
def wall_cells(
    cells: NDArray[Any],
    start: int,
    owners: Integers,
    solid_is_six: bool,
    parents: Labels,
    tables: JunctionTables,
    duals: Integers,
    sums: Integers,
    full: Integers,
    most_pairs: int,
) -> tuple[int, int]:
    """Add up the walls between cells, over the cubes of 2 × 2 × 2 voxels of as many rows as there is room for.

    Args:
        cells: (X + 2, Y + 2, Z + 2) of `number_cells`.
        start: the row of cubes to start with, of (X + 1)(Y + 1).
        owners: (N,) for each cell the number of its label, or −1 if it is background for all labels.
        solid_is_six: whether labels are 6-connected, else 26-connected.
        parents: (N,) forest of cells, where those of one label that are joined through edges and corners are united.
        tables: of codes.
        duals: (N,) sum of `CubeTables.dual` for each cell; that of a label is the sum over its cells.
        sums: (a power of two, 10), sums of weights by pairs of cells that touch where the background joins: the two
            cells, the lower number first, and four weights of either one as a solid with the other around it, all 0 if
            they only touch. A pair has one place; who comes later takes it.
        full: where the sums go that lose their place.
        most_pairs: that one cube may add.

    Returns:
        The row of cubes to go on with; and how many rows of `full` were written.
    """
    n_full, n_y, n_z = 0, cells.shape[1] - 1, cells.shape[2]
    n_rows, both = (cells.shape[0] - 1) * n_y, tables.both
    cube, found, codes = np.zeros(8, np.int64), np.zeros(8, np.int64), np.zeros(8, np.int64)
    row = start
    while row < n_rows and n_full + most_pairs * n_z <= len(full):
        x, y = row // n_y, row % n_y
        row_0, row_1, row_2, row_3 = cells[x, y], cells[x, y + 1], cells[x + 1, y], cells[x + 1, y + 1]
        e, f, g, h = row_0[0], row_1[0], row_2[0], row_3[0]
        z = 1
        while z < n_z:
            a, b, c, d = e, f, g, h
            n_cubes = 0
            while z < n_z and row_0[z] == a and row_1[z] == b and row_2[z] == c and row_3[z] == d:
                n_cubes += 1  # equal cubes count at once
                z += 1
            if n_cubes == 0:
                n_cubes = 1
                e, f, g, h = row_0[z], row_1[z], row_2[z], row_3[z]
                z += 1
            elif a == b and a == c and a == d:
                continue
            other = a  # a cell that is not the first; written so that the machine need not guess
            other = h if h != a else other
            other = g if g != a else other
            other = f if f != a else other
            other = e if e != a else other
            other = d if d != a else other
            other = c if c != a else other
            other = b if b != a else other
            of_a = 1 | (b == a) << 1 | (c == a) << 2 | (d == a) << 3
            of_a |= (e == a) << 4 | (f == a) << 5 | (g == a) << 6 | (h == a) << 7
            rest = (b == other) << 1 | (c == other) << 2 | (d == other) << 3
            rest |= (e == other) << 4 | (f == other) << 5 | (g == other) << 6 | (h == other) << 7
            if of_a | rest == 255:
                low, high, of_low = (a, other, of_a) if a < other else (other, a, rest)
                six = of_low if solid_is_six else 255 ^ of_low
                duals[low] += n_cubes * both[six, 4]
                duals[high] += n_cubes * both[six, 0]
                n_full, place = _place_of(low, high, sums, full, n_full)
                for column in range(8):
                    sums[place, 2 + column] += n_cubes * both[six, column]
            else:
                cube[0], cube[1], cube[2], cube[3], cube[4], cube[5], cube[6], cube[7] = a, b, c, d, e, f, g, h
                n_full = _add_junction(
                    cube, n_cubes, owners, solid_is_six, parents, tables, duals, found, codes, sums, full, n_full
                )
        row += 1
    return row, n_full


@compiled
def _place_of(low: int, high: int, sums: Integers, full: Integers, n_full: int) -> tuple[int, int]:
    """How many rows of `full` are written, and the place of a pair in the sums, which is its own from now on."""
    place = (low * 31 + high) & (len(sums) - 1)
    if sums[place, 0] != low or sums[place, 1] != high:
        if sums[place, 0] >= 0:
            for column in range(10):  # rows one number at a time: slices take Numba seconds to compile
                full[n_full, column] = sums[place, column]
            n_full += 1
        sums[place, 0], sums[place, 1] = low, high
        for column in range(8):
            sums[place, 2 + column] = 0
    return n_full, place


@compiled
def _add_junction(
    cube: Integers,
    n_cubes: int,
    owners: Integers,
    solid_is_six: bool,
    parents: Labels,
    tables: JunctionTables,
    duals: Integers,
    found: Integers,
    codes: Integers,
    sums: Integers,
    full: Integers,
    n_full: int,
) -> int:
    """Add the walls in a cube of several cells, in so many equal cubes; see `wall_cells`."""
    n_found = 0
    for corner in range(8):  # what the labels are, and which corners they have
        cell, place = cube[corner], 0
        while place < n_found and found[place] != cell:
            place += 1
        if place == n_found:
            found[place], codes[place] = cell, 0
            n_found += 1
        codes[place] |= 1 << corner
    if solid_is_six:  # then all around a label is joined
        for one in range(n_found):
            for other in range(one):
                low, high = min(found[one], found[other]), max(found[one], found[other])
                n_full, _ = _place_of(low, high, sums, full, n_full)
    else:
        for bit in (1, 2, 4):
            if cube[7] != cube[7 ^ bit]:
                low, high = min(cube[7], cube[7 ^ bit]), max(cube[7], cube[7 ^ bit])
                n_full, _ = _place_of(low, high, sums, full, n_full)
    for place in range(n_found):
        owner, code = owners[found[place]], codes[place]
        for other in range(n_found):
            if owner >= 0 and other != place and owners[found[other]] == owner:
                code |= codes[other]
                if other < place:
                    owner = -1  # it has been counted
                elif not solid_is_six:
                    unite(parents, found[place], found[other])
        if owner < 0:
            continue
        six = code if solid_is_six else 255 ^ code
        duals[found[place]] += n_cubes * tables.weights[255 ^ six, 0]
        for k in range(4):
            piece = tables.pieces[six, k]
            if piece == 0:
                break
            one, around = cube[tables.edges[six, k, 0]], cube[tables.edges[six, k, 1]]
            if not solid_is_six:
                one, around = around, one
            n_full, slot = _place_of(min(one, around), max(one, around), sums, full, n_full)
            first = 2 if one < around else 6
            for column in range(4):
                sums[slot, first + column] += n_cubes * tables.weights[piece, column]
    return n_full
