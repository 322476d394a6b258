"""Voxels around a solid up to a distance, the nearest first.

Every voxel takes over its way to the nearest voxel of the solid from its neighbors, so the time is that of the voxels
asked about, not of the volume. Rarely, another voxel of the solid is nearer by a small part of a voxel.

Reference:
    P. E. Danielsson, "Euclidean distance mapping", Computer Graphics and Image Processing 14, 1980,
    doi:10.1016/0146-664X(80)90054-4.
"""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Floats, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.homotopy.growth import Ranks
from topokit.core.homotopy.simple_points import OFFSETS, Counts, Indices

_SMOOTHINGS = 2  # of distances, where equal ones are ordered
_ELSEWHERE, _FREE = -1, -2  # ranks of voxels that may not be reached, and of those that may, but are not yet


def layer_around(
    solid: Counts, cells: Integers, ranks: Ranks, around: Integers, reach: float, spacing: tuple[float, float, float]
) -> Indices:
    """Those of some voxels of the background that are near a solid, the nearest first.

    Of equally near voxels those come first around which others are near, too: in the middle of a narrow part.

    Args:
        solid: (M,) 1 inside, flat.
        cells: (N,) flat indices of voxels of the background, with a layer around them.
        ranks: (M,) memory to work in, −1; it is −1 again afterwards.
        around: (27,) steps to the neighbors of a voxel.
        reach: largest distance between the centers of a voxel and of one of the solid.
        spacing: size of a voxel along each axis.

    Returns:
        (L,) flat indices.
    """
    ranks[cells] = _FREE
    voxels, distances = _reached(solid, cells, ranks, around, OFFSETS, np.array(spacing), reach)
    means = distances
    for _ in range(_SMOOTHINGS):
        means = _means(solid, ranks, voxels, means, around, reach)
    ranks[cells] = _ELSEWHERE
    order: Indices = voxels[np.lexsort((voxels, means, distances))]
    return order


@compiled
def _reached(
    solid: Counts, cells: Integers, ranks: Ranks, around: Integers, offsets: Indices, sizes: Floats, reach: float
) -> tuple[Indices, Floats]:
    """The free voxels that are near, and their distances; `ranks` becomes the row of each."""
    ends = _ends(solid, cells, around)
    voxels, waiting = [np.int64(0) for _ in range(0)], [np.int64(0) for _ in range(0)]
    squares, ways = np.empty(1024), np.empty((1024, 3), np.int16)
    is_waiting = np.empty(1024, np.bool_)
    way, n_seen = np.zeros(3, np.int64), 0
    while n_seen < len(ends) + len(waiting):
        is_end = n_seen < len(ends)
        voxel = ends[n_seen] if is_end else np.int64(0)
        if not is_end:
            row = waiting[n_seen - len(ends)]
            voxel, is_waiting[row] = voxels[row], False
            way[0], way[1], way[2] = ways[row, 0], ways[row, 1], ways[row, 2]
        n_seen += 1
        for k in range(27):
            x, y, z = way[0] + offsets[k, 0], way[1] + offsets[k, 1], way[2] + offsets[k, 2]
            square = (x * sizes[0]) ** 2 + (y * sizes[1]) ** 2 + (z * sizes[2]) ** 2
            is_known = not is_end and max(abs(x), abs(y), abs(z)) <= 1  # from the end itself
            if is_known or square > reach**2:
                continue
            other = voxel + around[k]
            own = ranks[other]
            if own == _ELSEWHERE:
                continue
            if own == _FREE:
                own = ranks[other] = len(voxels)
                voxels.append(other)
                if len(voxels) > len(squares):
                    squares, ways = np.concatenate((squares, squares)), np.concatenate((ways, ways))
                    is_waiting = np.concatenate((is_waiting, is_waiting))
                squares[own], is_waiting[own] = np.inf, False
            if square < squares[own]:
                squares[own], ways[own, 0], ways[own, 1], ways[own, 2] = square, x, y, z
                if not is_waiting[own]:
                    is_waiting[own] = True
                    waiting.append(own)
    return np.array(voxels), np.sqrt(squares[: len(voxels)])


@compiled
def _ends(solid: Counts, cells: Integers, around: Integers) -> Indices:
    """The voxels of the solid with one of the cells across a face, where ways begin."""
    ends = [np.int64(0) for _ in range(0)]
    for cell in cells:
        for k in (4, 10, 12, 14, 16, 22):
            if solid[cell + around[k]]:
                ends.append(np.int64(cell + around[k]))
    return np.unique(np.array(ends, dtype=np.int64))


@compiled
def _means(solid: Counts, ranks: Ranks, voxels: Indices, distances: Floats, around: Integers, reach: float) -> Floats:
    """Means (N,) of the distances around each of some voxels."""
    means = np.zeros(len(voxels))
    for row in range(len(voxels)):
        for step in around:
            other = voxels[row] + step
            if ranks[other] >= 0:
                means[row] += distances[ranks[other]] / 27
            elif not solid[other]:
                means[row] += reach / 27
    return means
