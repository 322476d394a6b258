"""The solid inside a closed surface on a grid: which voxel centers have an odd number of crossings below them."""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.grid.grid import Grid

_FINE = 1 << 18
"""Parts of a step to which vertices are rounded, so that products of 64 bits are exact on up to 4096 steps."""


def rasterized(vertices: Floats, faces: Integers, grid: Grid) -> Booleans:
    """Which vertices of a grid (X, Y, Z) are inside a closed surface.

    A line along the last axis crosses the surface an even number of times, whatever it meets. Vertices are rounded to
    fine parts of a step, and lines are moved by infinitesimal amounts along the first axis and, less, the second.

    Args:
        vertices: (V, 3).
        faces: (F, 3), every edge of which has an even number of faces.
        grid: any, of up to 4096 steps, in which the vertices are.
    """
    steps = (vertices - np.asarray(grid.origin)) / np.asarray(grid.spacing)
    crossings = np.zeros((*grid.shape[:2], grid.shape[2] + 1), bool)
    mark_crossings(np.rint(steps * _FINE).astype(np.int64), faces, crossings)
    return np.logical_xor.accumulate(crossings, axis=2)[..., :-1]


@compiled
def mark_crossings(vertices: Integers, faces: Integers, crossings: Booleans) -> None:
    """Flip (X, Y, Z + 1) the first voxel above each crossing with a triangle; vertices are in fine parts of steps."""
    n_x, n_y, n_last = crossings.shape
    for face in faces:
        a, b, c = vertices[face[0]], vertices[face[1]], vertices[face[2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0:
            continue
        first_x, last_x = max(0, min(a[0], b[0], c[0]) // _FINE), min(n_x - 1, max(a[0], b[0], c[0]) // _FINE)
        first_y, last_y = max(0, min(a[1], b[1], c[1]) // _FINE), min(n_y - 1, max(a[1], b[1], c[1]) // _FINE)
        for x in range(first_x, last_x + 1):
            for y in range(first_y, last_y + 1):
                left, up = x * _FINE, y * _FINE
                side = _is_left(a, b, left, up)
                if side != _is_left(b, c, left, up) or side != _is_left(c, a, left, up):
                    continue
                toward_b = ((left - a[0]) * (c[1] - a[1]) - (up - a[1]) * (c[0] - a[0])) / area
                toward_c = ((b[0] - a[0]) * (up - a[1]) - (b[1] - a[1]) * (left - a[0])) / area
                z = (a[2] + toward_b * (b[2] - a[2]) + toward_c * (c[2] - a[2])) / _FINE
                above = min(max(int(np.ceil(z)), 0), n_last - 1)
                crossings[x, y, above] = not crossings[x, y, above]


@compiled
def _is_left(start: Integers, end: Integers, x: int, y: int) -> bool:
    """Whether a point, moved by infinitesimal amounts, is on the left of an edge."""
    turn = (end[0] - start[0]) * (y - start[1]) - (end[1] - start[1]) * (x - start[0])
    if turn == 0:
        turn = start[1] - end[1] if start[1] != end[1] else end[0] - start[0]
    return turn > 0
