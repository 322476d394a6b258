"""The triangles of marching cubes for every cube, under either connectivity.

Where a face of a cube has its two inside corners across from each other, or a whole cube does, the eight signs do not
say how the surface runs; the connectivity does. With 26 the corners of the solid are joined there, with 6 they are
separated, so that the triangles of all cubes together have exactly the Euler characteristic that `grid.euler` counts.
(The usual tables decide such cases one by one, or by the values, and follow neither connectivity.)

Reference:
    W. E. Lorensen, H. E. Cline, "Marching cubes", SIGGRAPH 1987, doi:10.1145/37401.37422. The table is computed here.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np

from topokit.core.arrays import Integers

Cycle = list[int]

EDGES = tuple((corner, corner | bit) for bit in (4, 2, 1) for corner in range(8) if not corner & bit)
"""The twelve edges, four along each axis, by their ends; corner c lies at ((c >> 2) & 1, (c >> 1) & 1, c & 1)."""

_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Corners of the six faces, counterclockwise seen from outside the cube."""

_EDGE_OF = {frozenset(ends): edge for edge, ends in enumerate(EDGES)}
_FACES_OF = tuple({number for number, face in enumerate(_FACES) if set(ends) <= set(face)} for ends in EDGES)


@cache
def cube_triangles(connectivity: int) -> tuple[Integers, Integers]:
    """The triangles of all 256 cases; bit c of a case says whether corner c is inside.

    Args:
        connectivity: 6 or 26, that of the solid.

    Returns:
        Triangles (n, 3) of indices into `EDGES`, case after case, counterclockwise seen from outside the solid; and
        where each case starts (257,).
    """
    lists = [_triangles(case, connectivity == 26) for case in range(256)]
    starts = np.cumsum([0] + [len(triangles) for triangles in lists])
    return np.array([triangle for triangles in lists for triangle in triangles]), starts


def _triangles(case: int, joined: bool) -> list[Cycle]:
    cycles = _cycles(case, joined)
    across = 255 - case if not joined else case  # with 6, what is joined across the cube is the background
    if across in (0b10000001, 0b01000010, 0b00100100, 0b00011000):
        return _tube(*cycles)
    return [triangle for cycle in cycles for triangle in _fan(cycle)]


def _cycles(case: int, joined: bool) -> list[Cycle]:
    """The closed curves in which the surface meets the faces of the cube, as sequences of crossed edges."""
    following: dict[int, int] = {}
    for face in _FACES:
        inside = [bool(case >> corner & 1) for corner in face]
        edges = [_EDGE_OF[frozenset((face[k], face[k - 3]))] for k in range(4)]
        leaves = [k for k in range(4) if inside[k] and not inside[k - 3]]  # where the face's border goes out
        enters = [k for k in range(4) if not inside[k] and inside[k - 3]]
        for k in leaves:
            # on an ambiguous face the curves cut off its outside corners, or its inside corners
            across = (k + 1) % 4 if joined else k - 1
            following[edges[across if len(leaves) == 2 else enters[0]]] = edges[k]
    cycles = []
    while following:
        cycle = [min(following)]
        while (edge := following.pop(cycle[-1])) != cycle[0]:
            cycle.append(edge)
        cycles.append(cycle)
    return cycles


def _fan(cycle: Cycle) -> list[Cycle]:
    """Triangles that fill a cycle without a diagonal on a face of the cube, where the next cube may have the same."""
    n = len(cycle)
    turned = (cycle[start:] + cycle[:start] for start in range(n))
    tip, *rest = next(  # one of them serves in each of the 256 cases
        way for way in turned if all(_FACES_OF[way[0]].isdisjoint(_FACES_OF[way[k]]) for k in range(2, n - 1))
    )
    return [[tip, second, third] for second, third in pairwise(rest)]


def _tube(first: Cycle, second: Cycle) -> list[Cycle]:
    """The six triangles between the cycles around two opposite corners of the cube."""
    triangles = []
    for cycle, other in ((first, second), (second, first)):
        by_axis = {edge // 4: edge for edge in other}
        for k in range(3):
            triangles.append([cycle[k], cycle[k - 2], by_axis[cycle[k - 1] // 4]])
    return triangles
