"""The voxels around a solid up to a distance, the nearest first.

Every voxel takes over its way to the nearest voxel of the solid from its neighbors, so the time is that of the layer,
not of the volume. Rarely, another voxel of the solid is nearer by a small part of a voxel.

Reference:
    P. E. Danielsson, "Euclidean distance mapping", Computer Graphics and Image Processing 14, 1980,
    doi:10.1016/0146-664X(80)90054-4.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.homotopy.growth import Ranks, strides_around
from topokit.core.homotopy.simple_points import OFFSETS, Counts, Indices

MARGIN = 2
"""Layers around a volume that are never in the layer."""

Box = tuple[slice, slice, slice]

_SMOOTHINGS = 2  # of distances, where equal ones are ordered
# Ranks of voxels that are not reached, and may not be, or may.
_ELSEWHERE, _FREE = -2, -1


def layer_around(
    solid: Booleans, boxes: Sequence[Box], reach: float, spacing: tuple[float, float, float]
) -> tuple[Indices, Ranks]:
    """The voxels of the background within some boxes that are near a solid.

    Of equally near voxels those come first around which others are near, too: in the middle of a narrow part.

    Args:
        solid: (X, Y, Z).
        boxes: slices of it; `MARGIN` voxels at its ends are left out.
        reach: largest distance between the centers of a voxel and of one of the solid.
        spacing: size of a voxel along each axis.

    Returns:
        Flat indices (N,), and memory (X Y Z,) for `grow`.
    """
    ranks = np.full(solid.size, _ELSEWHERE, dtype=np.int32)
    grid = ranks.reshape(solid.shape)
    for box in boxes:
        grid[box] = _FREE
    for axis in range(3):
        ends = np.moveaxis(grid, axis, 0)
        ends[:MARGIN] = ends[len(ends) - MARGIN :] = _ELSEWHERE
    around, inside = strides_around(solid.shape), solid.ravel().view(np.int8)
    voxels, distances = _reached(inside, ranks, around, OFFSETS, np.array(spacing), reach)
    means = distances
    for _ in range(_SMOOTHINGS):
        means = _means(inside, ranks, voxels, means, around, reach)
    ranks[:] = -1
    return voxels[np.lexsort((voxels, means, distances))], ranks


@compiled
def _reached(
    solid: Counts, ranks: Ranks, around: Integers, offsets: Indices, sizes: Floats, reach: float
) -> tuple[Indices, Floats]:
    """The free voxels that are near, and their distances; `ranks` becomes the row of each."""
    voxels = [0 for _ in range(0)]
    for voxel in range(around[-1], len(solid) - around[-1]):
        if solid[voxel]:
            is_beside = False
            for k in (4, 10, 12, 14, 16, 22):  # across faces
                is_beside |= ranks[voxel + around[k]] == _FREE and not solid[voxel + around[k]]
            if is_beside:
                voxels.append(voxel)
    n_ends = len(voxels)
    distances, is_waiting = [0.0 for _ in range(n_ends)], [True for _ in range(n_ends)]
    ways, way = np.zeros((n_ends + 1024, 3), np.int16), np.zeros(3, np.int16)
    waiting, n_seen = list(range(n_ends)), 0
    while n_seen < len(waiting):
        row = waiting[n_seen]
        n_seen, is_waiting[row] = n_seen + 1, False
        for k in range(27):
            other = voxels[row] + around[k]
            if solid[other] or ranks[other] == _ELSEWHERE:
                continue
            square = 0.0
            for axis in range(3):
                way[axis] = ways[row, axis] + offsets[k, axis]
                square += (way[axis] * sizes[axis]) ** 2
            distance = np.sqrt(square)
            if distance > reach:
                continue
            if ranks[other] == _FREE:
                ranks[other] = len(voxels)
                voxels.append(other)
                distances.append(np.inf)
                is_waiting.append(False)
                if len(voxels) > len(ways):
                    ways = np.concatenate((ways, ways))
            own = ranks[other]
            if distance < distances[own]:
                distances[own], ways[own] = distance, way
                if not is_waiting[own]:
                    is_waiting[own] = True
                    waiting.append(own)
    for place in range(n_ends, len(voxels)):
        ranks[voxels[place]] -= n_ends
    return np.array(voxels[n_ends:]), np.array(distances[n_ends:])


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
