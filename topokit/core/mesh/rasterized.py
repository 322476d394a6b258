"""The solid inside a closed surface on a grid: which voxel centers have an odd number of crossings below them."""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.grid.grid import Grid


def rasterized(vertices: Floats, faces: Integers, grid: Grid) -> Booleans:
    """Which vertices of a grid (X, Y, Z) are inside a closed surface.

    A line along the last axis crosses the surface an even number of times, whatever it meets: a line that runs exactly
    through an edge or a vertex is taken to pass on one side of it, the same for all triangles there.

    Args:
        vertices: (V, 3).
        faces: (F, 3), every edge of which has an even number of faces.
        grid: any.
    """
    steps = (vertices - np.asarray(grid.origin)) / np.asarray(grid.spacing)
    crossings = np.zeros((*grid.shape[:2], grid.shape[2] + 1), bool)
    mark_crossings(steps, faces, crossings)
    return np.logical_xor.accumulate(crossings, axis=2)[..., :-1]


@compiled
def mark_crossings(vertices: Floats, faces: Integers, crossings: Booleans) -> None:
    """Flip (X, Y, Z + 1) the first voxel above each crossing with a triangle; vertices are in steps of the grid."""
    n_x, n_y, n_last = crossings.shape
    for face in faces:
        a, b, c = vertices[face[0]], vertices[face[1]], vertices[face[2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        first_x, last_x = np.ceil(min(a[0], b[0], c[0])), np.floor(max(a[0], b[0], c[0]))
        first_y, last_y = np.ceil(min(a[1], b[1], c[1])), np.floor(max(a[1], b[1], c[1]))
        for x in range(max(0, int(first_x)), min(n_x - 1, int(last_x)) + 1):
            for y in range(max(0, int(first_y)), min(n_y - 1, int(last_y)) + 1):
                side = _is_left(vertices, face[0], face[1], x, y)
                if side != _is_left(vertices, face[1], face[2], x, y):
                    continue
                if side != _is_left(vertices, face[2], face[0], x, y) or area == 0:
                    continue
                toward_b = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
                toward_c = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
                z = a[2] + toward_b * (b[2] - a[2]) + toward_c * (c[2] - a[2])
                above = min(max(int(np.ceil(z)), 0), n_last - 1)
                crossings[x, y, above] = not crossings[x, y, above]


@compiled
def _is_left(vertices: Floats, start: int, end: int, x: int, y: int) -> bool:
    """Whether a point is on the left of an edge; computed alike in both directions, so that neighbors agree."""
    low, high = min(start, end), max(start, end)
    a, b = vertices[low], vertices[high]
    turn = (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
    return (turn >= 0) == (start < end)
