"""Even downsampling of large clouds, which bounds the cost of steps that are not linear in the number of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.core.cloud.neighborhoods import FEWEST_POINTS, fit_planes, with_neighbors
from topokit.core.labels import count_distinct
from topokit.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_POINTS = 30_000
"""Clouds up to this size are used whole."""

KEPT_POINTS = 20_000
"""Larger clouds are reduced to about this size."""


def downsample(points: Floats, areas: Floats | None = None) -> tuple[Integers, Floats | None]:
    """Indices of the points to keep: all distinct points, or about 20 000 of more than 30 000, evenly spread.

    Of coinciding points the first is kept. For large clouds space is divided into cubes and the point nearest to the
    center of each cube is kept; the side is chosen so that about `KEPT_POINTS` cubes are occupied. Deterministic.

    Args:
        points: (N, 3), finite, not all in one place.
        areas: (N,), surface area that each point stands for.

    Returns:
        Indices of the kept points, ascending, and their areas, each the sum over the points it represents.

    Raises:
        InputError: if fewer than 32 different points are left.
    """
    kept, inverse = _distinct(points) if len(points) <= MOST_POINTS else _one_per_cube(points)
    if len(kept) < FEWEST_POINTS:
        raise InputError(f"{len(kept)} distinct points are too few to bound a solid: {FEWEST_POINTS} are needed.")
    ascending = np.argsort(kept)
    if areas is not None:
        areas = np.asarray(np.bincount(inverse, areas)[ascending], dtype=np.float64)
    return kept[ascending], areas


def _distinct(points: Floats) -> tuple[Integers, Integers]:
    """First point at each position, and for every point the group it belongs to, (N,)."""
    _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    return first, inverse.ravel()


def _one_per_cube(points: Floats) -> tuple[Integers, Integers]:
    """One point per cube, and for every point the cube it lies in, (N,), in the same order."""
    low = points.min(0)
    extent = float((points.max(0) - low).max())
    smallest, largest = 0.0, extent
    side = extent / 100
    for _ in range(16):  # a surface meets about side⁻² cubes
        cube = _cubes(points - low, side)
        n_cubes = count_distinct(cube)
        if 0.9 * KEPT_POINTS <= n_cubes <= 1.1 * KEPT_POINTS:
            break
        smallest, largest = (side, largest) if n_cubes > KEPT_POINTS else (smallest, side)
        guess = side * (n_cubes / KEPT_POINTS) ** 0.5
        side = guess if smallest < guess < largest else (smallest + largest) / 2
    offset = (points - low) / side % 1 - 0.5
    order = np.lexsort(((offset * offset).sum(1), cube))
    _, first, sorted_inverse = np.unique(cube[order], return_index=True, return_inverse=True)
    inverse = np.empty_like(order)
    inverse[order] = sorted_inverse
    return order[first], inverse


def spread_signs(points: Floats, kept: Integers, normals: Floats, n_neighbors: int = 16) -> Floats:
    """Normals for all points from the oriented normals of the kept ones: own plane, sign of the nearest kept point.

    A kept point, and every point that coincides with it, has the kept point's normal.

    Args:
        points: (N, 3).
        kept: (M,), indices into the points.
        normals: (M, 3), unit, outward.
        n_neighbors: neighbors that each plane is fitted to.

    Returns:
        (N, 3), unit, outward.
    """
    planes, _ = fit_planes(points, with_neighbors(points, n_neighbors))
    distance, nearest = cKDTree(points[kept]).query(points)
    guide = normals[nearest]
    signed = planes * np.where((planes * guide).sum(1) < 0, -1.0, 1.0)[:, None]
    return np.where(distance[:, None] == 0, guide, signed)


def _cubes(offsets: Floats, side: float) -> Integers:
    """Index of the cube that each point (N, 3) lies in."""
    cell = (offsets / side).astype(np.int64)
    n_x, n_y, _ = cell.max(0) + 1
    return np.asarray((cell[:, 2] * n_y + cell[:, 1]) * n_x + cell[:, 0])
