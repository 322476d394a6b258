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
    ends = _ends(solid, ranks, around)
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
            if own == _ELSEWHERE or (own == _FREE and solid[other]):
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
def _ends(solid: Counts, ranks: Ranks, around: Integers) -> Indices:
    """The voxels of the solid with a free one across a face, where ways begin."""
    ends = [np.int64(0) for _ in range(0)]
    for voxel in range(around[-1], len(solid) - around[-1]):
        if solid[voxel]:
            for k in (4, 10, 12, 14, 16, 22):
                if not solid[voxel + around[k]] and ranks[voxel + around[k]] == _FREE:
                    ends.append(np.int64(voxel))
                    break
    return np.array(ends)


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
