"""What each of the 256 cubes of 2 × 2 × 2 voxels adds to the surface between two phases.

Of the two phases one is 6-connected, the other 26-connected (see `grid.euler`). All voxels of the 26-connected phase in
a cube are joined to each other, so they form one region there; those of the 6-connected phase form one to four pieces.
The surface in the cube is then that of its pieces, each against the same region.

A vertex of the cubical complex lies in eight cubes, an edge in four, a square in two: if they count 1, 2, 4 and 8
eighths in each cube, the cubes around a connected surface sum to its part of χ. Cubes that are constant along an axis
add nothing: flat and straight parts of a surface cost no sum.
"""

from __future__ import annotations

from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_AXIS_BITS = (2, 1, 4)  # corner c of a cube lies at x = (c >> 1) & 1, y = c & 1, z = (c >> 2) & 1


class CubeTables(NamedTuple):
    """Tables with one row for each code; bit c of a code says whether corner c is in the 6-connected phase.

    Attributes:
        pieces: (256, 4) uint8, the codes of the pieces of a code; 0 where there are fewer than four.
        weights: (256, 4) int64 of one piece: 8 × its part of χ of the solid piece, then for each axis the number of
            cube edges along it that cross the surface (every voxel face lies in four cubes).
        dual: (256,) int64, 8 × the part of χ of the other voxels, were they the 6-connected phase.
    """

    pieces: NDArray[np.uint8]
    weights: NDArray[np.int64]
    dual: NDArray[np.int64]


@cache
def cube_tables() -> CubeTables:
    """The tables, computed once."""
    pieces = np.zeros((256, 4), dtype=np.uint8)
    weights = np.zeros((256, 4), dtype=np.int64)
    for code in range(256):
        found = _pieces(code)
        pieces[code, : len(found)] = found
        weights[code] = (_euler_eighths(code), *(_crossings(code, bit) for bit in _AXIS_BITS))
    return CubeTables(pieces, weights, weights[::-1, 0].copy())


def _pieces(code: int) -> list[int]:
    """The codes of the groups of corners that are joined along edges of the cube."""
    found, left = [], code
    while left:
        piece = left & -left
        while (grown := _grown(piece) & code) != piece:
            piece = grown
        found.append(piece)
        left &= ~piece
    return found


def _grown(piece: int) -> int:
    """The corners of a piece and their neighbors along the edges of the cube."""
    corners = [corner for corner in range(8) if piece >> corner & 1]
    return piece | sum({1 << (corner ^ bit) for corner in corners for bit in _AXIS_BITS} - {1 << c for c in corners})


def _euler_eighths(code: int) -> int:
    """Vertices − 2 edges + 4 squares − 8 cubes of which all corners are in the code."""
    total = 0
    for n_axes in range(4):
        for axes in combinations(_AXIS_BITS, n_axes):
            bases = [corner for corner in range(8) if not any(corner & bit for bit in axes)]
            spanned = [sum(chosen) for n in range(n_axes + 1) for chosen in combinations(axes, n)]
            full = sum(all(code >> (base + offset) & 1 for offset in spanned) for base in bases)
            total += (-2) ** n_axes * full
    return total


def _crossings(code: int, bit: int) -> int:
    """Edges of the cube along an axis with one end in the code."""
    return sum((code >> corner & 1) != (code >> (corner | bit) & 1) for corner in range(8) if not corner & bit)
