"""The surface of a solid on a grid as triangles that have exactly the counted topology."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.grid.cube_table import EDGES, cube_triangles
from topokit.core.grid.grid import Grid, occupied_box
from topokit.core.surface import TriangleSurface

Locate = Callable[[Floats, Floats, Floats, Floats], Floats]
"""Shares (N,) of 0 … 1 at which the surface crosses grid edges, from their ends (N, 3) twice and the values there."""

_NEAR_END = 1e-3  # share of an edge that its crossing keeps away from the ends, so that no triangle is degenerate
_SLAB = 1 << 22  # grid cells handled at a time


def level_surface(values: Tensor, grid: Grid, connectivity: int, locate: Locate | None = None) -> TriangleSurface:
    """The closed surface of {values > 0}, whose χ is that of `grid.euler.surface_euler`.

    One vertex lies on every grid edge that leaves the solid; the triangles of a cell follow from the signs at its
    corners. Beyond the grid is background: a solid that reaches the border is closed half a step outside of it.

    Args:
        values: (X, Y, Z), positive inside, with at least one vertex inside. NaN is outside.
        grid: where the values are.
        connectivity: 6 or 26, that of the solid.
        locate: where the surface crosses an edge; linear interpolation of the values if None. Edges with a value that
            is not finite, among them those that leave the grid, are crossed half-way.
    """
    box = occupied_box(values > 0)
    padded = _padded(values, box)
    keys, faces = np.unique(_triangle_corners(padded > 0, connectivity), return_inverse=True)
    flat, axis = np.divmod(keys, 3)
    low = np.stack(np.unravel_index(flat, padded.shape), axis=1)
    high = low + np.eye(3, dtype=np.int64)[axis]
    low_value, high_value = (padded[tuple(ends.T)].astype(np.float64) for ends in (low, high))
    spacing, first = np.asarray(grid.spacing), np.array([start - 1 for start, _ in box])
    starts, stops = ((ends + first) * spacing + np.asarray(grid.origin) for ends in (low, high))
    share = np.full(len(keys), 0.5)
    known = np.isfinite(low_value) & np.isfinite(high_value)
    share[known] = (locate or _linear)(starts[known], stops[known], low_value[known], high_value[known])
    share = np.clip(share, _NEAR_END, 1 - _NEAR_END)[:, None]
    return TriangleSurface((1 - share) * starts + share * stops, faces.reshape(-1, 3))


def _linear(low: Floats, high: Floats, low_value: Floats, high_value: Floats) -> Floats:
    return low_value / (low_value - high_value)


def _padded(values: Tensor, box: list[tuple[int, int]]) -> NDArray[np.floating]:
    """The part of the values around the solid, one layer wider; −∞ beyond the grid."""
    part = values[tuple(slice(max(start - 1, 0), stop + 1) for start, stop in box)]
    missing = [(int(start == 0), int(stop == size)) for (start, stop), size in zip(box, values.shape, strict=True)]
    array = part.cpu().numpy()
    return np.pad(array, missing, constant_values=-np.inf)


def _triangle_corners(inside: Booleans, connectivity: int) -> Integers:
    """The grid edges (n,) on which the triangles' corners lie: 3 × the flat index of the lower end + the axis."""
    triangles, starts = cube_triangles(connectivity)
    _, n_y, n_z = inside.shape
    offsets = np.array([((c >> 2 & 1) * n_y + (c >> 1 & 1)) * n_z + (c & 1) for c, _ in EDGES])
    edge_keys = 3 * offsets + np.repeat(np.arange(3), 4)
    found = []
    layers = max(1, _SLAB // (n_y * n_z))
    for start in range(0, inside.shape[0] - 1, layers):
        case = _cases(inside[start : start + layers + 1])
        x, y, z = np.nonzero((case > 0) & (case < 255))
        cases = case[x, y, z].astype(np.int64)
        base = 3 * (((x + start) * n_y + y) * n_z + z)
        counts = starts[cases + 1] - starts[cases]
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        chosen = triangles[np.repeat(starts[cases], counts) + within]
        found.append((np.repeat(base, counts)[:, None] + edge_keys[chosen]).ravel())
    return np.concatenate(found)


def _cases(inside: Booleans) -> NDArray[np.uint8]:
    """Which of the eight corners of every cell are inside, as bits."""
    x, y, z = (size - 1 for size in inside.shape)
    case = np.zeros((x, y, z), dtype=np.uint8)
    for corner in range(8):
        i, j, k = corner >> 2 & 1, corner >> 1 & 1, corner & 1
        case |= inside[i : x + i, j : y + j, k : z + k].astype(np.uint8) << corner
    return case
