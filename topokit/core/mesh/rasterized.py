"""The solid inside a closed surface on a grid, by signed crossings of the grid's lines with the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Booleans, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.grid.grid import Grid
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError

Steps = NDArray[np.int16]

_FINE = 1 << 18
"""Parts of a step to which vertices are rounded, so that products of 64 bits are exact on up to 4096 steps."""


def rasterized(surface: TriangleSurface, grid: Grid) -> Booleans:
    """The vertices of a grid (X, Y, Z) around which a closed surface winds a positive number of times.

    Surfaces that overlap enclose their union. A line along the last axis leaves the surface as often as it enters,
    whatever it meets: vertices are rounded to fine parts of a step, and lines are moved by infinitesimal amounts along
    the first axis and, less, the second.

    Args:
        surface: closed triangles, counterclockwise seen from outside the solid; those around cavities from within.
        grid: any, of up to 4096 steps, in which the vertices are.

    Raises:
        InputError: if the surface is not closed.
    """
    steps = (surface.vertices - np.asarray(grid.origin)) / np.asarray(grid.spacing)
    entered = np.zeros((*grid.shape[:2], grid.shape[2] + 1), np.int16)
    add_crossings(np.rint(steps * _FINE).astype(np.int64), surface.faces, entered)
    winding = np.cumsum(entered, axis=2, out=entered)
    if winding[..., -1].any():
        raise InputError("the surface is not closed: lines through it enter it more often than they leave it.")
    return winding[..., :-1] > 0


@compiled
def add_crossings(vertices: Integers, faces: Integers, entered: Steps) -> None:
    """Count (X, Y, Z + 1), at the first vertex above each crossing with a triangle, how often a line enters the solid;
    places are in fine parts of steps."""
    n_x, n_y, n_last = entered.shape
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
                entered[x, y, above] += -1 if area > 0 else 1


@compiled
def _is_left(start: Integers, end: Integers, x: int, y: int) -> bool:
    """Whether a point, moved by infinitesimal amounts, is on the left of an edge."""
    turn = (end[0] - start[0]) * (y - start[1]) - (end[1] - start[1]) * (x - start[0])
    if turn == 0:
        turn = start[1] - end[1] if start[1] != end[1] else end[0] - start[0]
    return turn > 0
