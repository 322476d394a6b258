"""The definition of matched features, word for word: chains of all cells over GF(2)."""

from __future__ import annotations

from itertools import product

import numpy as np


def matched_by_definition(first, second, connectivity: int) -> list[tuple[int, int, int]]:
    """Betti numbers of both solids and dim(im H_k(first) ∩ im H_k(second)) in H_k(union), for k = 0, 1, 2."""
    solids = [_complex(solid, connectivity) for solid in (first, second, first | second)]
    cells = sorted(solids[2], key=lambda cell: (_dimension(cell), cell))
    number = {cell: k for k, cell in enumerate(cells)}
    found = []
    for k in range(3):
        cycles = [_cycles([c for c in solid if _dimension(c) == k], number) for solid in solids]
        bounds = [[_boundary(c, number) for c in solid if _dimension(c) == k + 1] for solid in solids]
        filled = _rank(bounds[2])
        one, other, both = (_rank(bounds[2] + c) - filled for c in (cycles[0], cycles[1], cycles[0] + cycles[1]))
        betti = [len(c) - _rank(b) for c, b in zip(cycles, bounds, strict=True)]
        found.append((betti[0], betti[1], one + other - both))
    return found


def _complex(solid, connectivity: int) -> set[tuple[int, int, int]]:
    """Cells by twice their middle: odd along the axes along which they extend."""
    voxels = {tuple(voxel) for voxel in np.argwhere(solid).tolist()}
    around = list(product((-1, 0, 1), repeat=3))
    if connectivity == 26:  # the faces of the unit cubes around voxels
        return {tuple(2 * x + 1 + d for x, d in zip(v, step, strict=True)) for v in voxels for step in around}
    cells = set()
    for v, step in product(voxels, product((0, 1), repeat=3)):  # blocks of voxels that are all inside
        corners = product(*((x, x + d) if d else (x,) for x, d in zip(v, step, strict=True)))
        if all(corner in voxels for corner in corners):
            cells.add(tuple(2 * x + d for x, d in zip(v, step, strict=True)))
    return cells


def _dimension(cell) -> int:
    return sum(x % 2 for x in cell)


def _boundary(cell, number) -> int:
    faces = 0
    for axis in range(3):
        if cell[axis] % 2:
            for step in (-1, 1):
                faces ^= 1 << number[(*cell[:axis], cell[axis] + step, *cell[axis + 1 :])]
    return faces


def _cycles(cells, number) -> list[int]:
    """A basis of the kernel of the boundary map: columns that become 0, with the columns that were added."""
    pivots, cycles = {}, []
    for cell in cells:
        column, chain = _boundary(cell, number), 1 << number[cell]
        while column and column.bit_length() in pivots:
            other = pivots[column.bit_length()]
            column, chain = column ^ other[0], chain ^ other[1]
        if column:
            pivots[column.bit_length()] = column, chain
        else:
            cycles.append(chain)
    return cycles


def _rank(vectors) -> int:
    pivots = {}
    for vector in vectors:
        while vector and vector.bit_length() in pivots:
            vector ^= pivots[vector.bit_length()]
        if vector:
            pivots[vector.bit_length()] = vector
    return len(pivots)
