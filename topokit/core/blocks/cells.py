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
from topokit.core.blocks.planes import Labels, add_to_pair, unite


class JunctionTables(NamedTuple):
    """Tables with one row for each code of a cube, as in `cubes.CubeTables`.

    Attributes:
        pieces: (256, 4) see there.
        weights: (256, 4) see there, of one piece.
        dual: (256,) see there.
        whole: (256, 4) sums of weights over the pieces of a code; 0 if the cube is of one phase.
        edges: (256, 4, 2) for each piece a corner of it, and one beside it that is not in the 6-connected phase.
    """

    pieces: NDArray[np.uint8]
    weights: Integers
    dual: Integers
    whole: Integers
    edges: Integers


@cache
def junction_tables() -> JunctionTables:
    """The tables, computed once."""
    pieces, weights, dual = cube_tables()
    whole = np.where(pieces[..., None] > 0, weights[pieces], 0).sum(1)
    whole[[0, 255]] = 0
    edges = np.zeros((256, 4, 2), np.int64)
    for code in range(255):
        for number, piece in enumerate(pieces[code]):
            corners = [corner for corner in range(8) if piece >> corner & 1]
            across = ((c, c ^ bit) for c in corners for bit in (1, 2, 4) if not code >> (c ^ bit) & 1)
            edges[code, number] = next(across, (0, 0))
    return JunctionTables(pieces, weights, dual, whole, edges)


@compiled
def number_cells(values: NDArray[Any], cells: NDArray[Any]) -> int:
    """Write the number of its cell for every voxel; cells are numbered from 1 on in the order of their first voxels.

    Args:
        values: (X, Y, Z).
        cells: (X + 2, Y + 2, Z + 2), zero, where the numbers are written.

    Returns:
        The largest number.
    """
    n_x, n_y, n_z = values.shape
    flat = cells.reshape(-1)
    row, layer = n_z + 2, (n_y + 2) * (n_z + 2)
    for x in range(n_x):
        for y in range(n_y):
            start = (x + 1) * layer + (y + 1) * row + 1
            joined_y, joined_x = False, False  # whether the last voxel joined the same cells
            for z in range(n_z):
                here, value = start + z, values[x, y, z]
                goes_on = z > 0 and values[x, y, z - 1] == value
                flat[here] = flat[here - 1] if goes_on else here
                like_y = y > 0 and values[x, y - 1, z] == value
                like_x = x > 0 and values[x - 1, y, z] == value
                if like_y and not (goes_on and joined_y):
                    unite(flat, here, here - row)
                if like_x and not (goes_on and joined_x):
                    unite(flat, here, here - layer)
                joined_y, joined_x = like_y, like_x
    n_cells = 0
    for x in range(n_x):
        for y in range(n_y):
            start = (x + 1) * layer + (y + 1) * row + 1
            for here in range(start, start + n_z):  # what stands before it has its number already
                if flat[here] == here:
                    n_cells += 1
                    flat[here] = n_cells
                else:
                    flat[here] = flat[flat[here]]
    return n_cells


@compiled
def describe_cells(cells: NDArray[Any], nodes: Integers) -> None:
    """Write a row of `part.NODE_COLUMNS` for each cell; of cell 0 only where it begins.

    Args:
        cells: (X + 2, Y + 2, Z + 2) of `number_cells`.
        nodes: (N, 8), zero, where the rows are written.
    """
    n_x, n_y, n_z = cells.shape
    for x in range(1, n_x - 1):
        for y in range(1, n_y - 1):
            z = 1
            while z < n_z - 1:
                start, cell = z, cells[x, y, z]
                while z < n_z - 1 and cells[x, y, z] == cell:
                    z += 1
                node = nodes[cell]
                if node[0] == 0:
                    node[1] = (x * n_y + y) * n_z + start
                    node[2], node[3], node[4] = x, y, start
                node[0] += z - start
                node[3], node[4] = min(node[3], y), min(node[4], start)
                node[5], node[6], node[7] = x + 1, max(node[6], y + 1), max(node[7], z)


@compiled
def wall_cells(
    cells: NDArray[Any],
    start: int,
    owners: Integers,
    solid_is_six: bool,
    parents: Labels,
    tables: JunctionTables,
    dual_sums: Integers,
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
        dual_sums: sum of `dual` for each label.
        sums: (a power of two, 6), sums of weights by pairs of cells that touch where the background joins: one of the
            label, one around it, and four weights, all 0 if they only touch. A pair has one place; who comes later
            takes it.
        full: where the sums go that lose their place.
        most_pairs: that one cube may add.

    Returns:
        The row of cubes to go on with; and how many rows of `full` were written.
    """
    n_full, n_y, n_z = 0, cells.shape[1] - 1, cells.shape[2]
    n_rows = (cells.shape[0] - 1) * n_y
    whole, dual = tables.whole, tables.dual
    cube, found, codes = np.zeros(8, np.int64), np.zeros(8, np.int64), np.zeros(8, np.int64)
    row = start
    while row < n_rows and n_full + most_pairs * n_z <= len(full):
        x, y = row // n_y, row % n_y
        row_0, row_1, row_2, row_3 = cells[x, y], cells[x, y + 1], cells[x + 1, y], cells[x + 1, y + 1]
        z = 1
        while z < n_z:
            a, b, c, d = row_0[z - 1], row_1[z - 1], row_2[z - 1], row_3[z - 1]
            n_cubes = 0
            while z < n_z and row_0[z] == a and row_1[z] == b and row_2[z] == c and row_3[z] == d:
                n_cubes += 1  # equal cubes count at once
                z += 1
            if a == b == c == d:
                n_cubes = 0
            if n_cubes == 0:
                if z == n_z:
                    break
                n_cubes = 1
                z += 1
            e, f, g, h = row_0[z - 1], row_1[z - 1], row_2[z - 1], row_3[z - 1]
            other = (
                b if b != a else c if c != a else d if d != a else e if e != a else f if f != a else g if g != a else h
            )
            code = 1 | (b == a) << 1 | (c == a) << 2 | (d == a) << 3
            code |= (e == a) << 4 | (f == a) << 5 | (g == a) << 6 | (h == a) << 7
            rest = (b == other) << 1 | (c == other) << 2 | (d == other) << 3
            rest |= (e == other) << 4 | (f == other) << 5 | (g == other) << 6 | (h == other) << 7
            if code | rest == 255:
                for cell, around, own in ((a, other, code), (other, a, rest)):
                    six = own if solid_is_six else 255 ^ own
                    if owners[cell] >= 0:
                        dual_sums[owners[cell]] += n_cubes * dual[six]
                        n_full = add_to_pair(cell, around, n_cubes, whole, six, sums, full, n_full)
                if owners[a] < 0 and owners[other] < 0:
                    n_full = add_to_pair(a, other, 0, whole, 0, sums, full, n_full)
            else:
                cube[0], cube[1], cube[2], cube[3], cube[4], cube[5], cube[6], cube[7] = a, b, c, d, e, f, g, h
                n_full = _add_junction(
                    cube, n_cubes, owners, solid_is_six, parents, tables, dual_sums, found, codes, sums, full, n_full
                )
        row += 1
    return row, n_full


@compiled
def _add_junction(
    cube: Integers,
    n_cubes: int,
    owners: Integers,
    solid_is_six: bool,
    parents: Labels,
    tables: JunctionTables,
    dual_sums: Integers,
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
                n_full = add_to_pair(found[one], found[other], 0, tables.whole, 0, sums, full, n_full)
    else:
        for bit in (1, 2, 4):
            if cube[7] != cube[7 ^ bit]:
                n_full = add_to_pair(cube[7], cube[7 ^ bit], 0, tables.whole, 0, sums, full, n_full)
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
        dual_sums[owner] += n_cubes * tables.dual[six]
        for k in range(4):
            piece = tables.pieces[six, k]
            if piece == 0:
                break
            one, other = cube[tables.edges[six, k, 0]], cube[tables.edges[six, k, 1]]
            if not solid_is_six:
                one, other = other, one
            n_full = add_to_pair(one, other, n_cubes, tables.weights, piece, sums, full, n_full)
    return n_full
