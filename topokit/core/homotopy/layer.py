"""Voxels around a solid up to a distance, the nearest first.

Every voxel takes over its way to the nearest voxel of the solid from its neighbors, so the time is that of the voxels
asked about, not of the volume. Rarely, another voxel of the solid is nearer by a small part of a voxel.

Reference:
    P. E. Danielsson, "Euclidean distance mapping", Computer Graphics and Image Processing 14, 1980,
    doi:10.1016/0146-664X(80)90054-4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.homotopy.growth import Nodes, Ranks
from topokit.core.homotopy.simple_points import OFFSETS, Counts, Indices
from topokit.core.homotopy.zone import Zone

_SMOOTHINGS = 2  # of distances, where equal ones are ordered
_ELSEWHERE, _FREE = -1, -2  # ranks of voxels that may not be reached, and of those that may, but are not yet


class Layer(NamedTuple):
    """Voxels, each part of the zone by itself: what happens in one does not matter to the others.

    Attributes:
        voxels: (L,) flat indices; within a part the nearest first.
        places: (L,) of each of them in the order of distance in the whole zone.
    """

    voxels: Indices
    places: Indices

    def those(self, chosen: Booleans) -> Layer:
        """Some of them."""
        return Layer(self.voxels[chosen], self.places[chosen])

    def in_order(self, chosen: Booleans) -> Indices:
        """Some of the voxels, in the order of distance in the whole zone."""
        rows = np.flatnonzero(chosen)
        return self.voxels[rows[np.argsort(self.places[rows])]]


def layer_around(
    solid: Counts, cells: Integers, zone: Zone, ranks: Ranks, reach: float, spacing: tuple[float, float, float]
) -> Layer:
    """Those of some voxels of the background that are near a solid, the nearest first.

    Of equally near voxels those come first around which others are near, too: in the middle of a narrow part.

    Args:
        solid: (M,) 1 inside, flat.
        cells: (N,) flat indices of voxels of the background, ascending.
        zone: that the cells are in.
        ranks: (K,) of its nodes, memory to work in, −1; it is −1 again afterwards.
        reach: largest distance between the centers of a voxel and of one of the solid.
        spacing: size of a voxel along each axis.

    """
    nodes, around = zone.nodes, zone.around
    ranks[nodes[cells]] = _FREE
    voxels, distances = _reached(solid, cells, nodes, ranks, around, OFFSETS, np.array(spacing), reach)
    means = distances
    for _ in range(_SMOOTHINGS):
        means = _means(solid, nodes, ranks, voxels, means, around, reach)
    ranks[nodes[cells]] = _ELSEWHERE
    voxels = voxels[np.lexsort((voxels, means, distances))]
    places = np.argsort(zone.part_of(voxels), kind="stable")
    return Layer(voxels[places], places)


@compiled
def _reached(
    solid: Counts,
    cells: Integers,
    nodes: Nodes,
    ranks: Ranks,
    around: Integers,
    offsets: Indices,
    sizes: Floats,
    reach: float,
) -> tuple[Indices, Floats]:
    """The free voxels that are near, and their distances; `ranks` becomes the row of each."""
    voxels, waiting = [np.int64(0) for _ in range(0)], [np.int64(0) for _ in range(0)]
    squares, ways = np.empty(1024), np.empty((1024, 3), np.int16)
    of_steps = (offsets[:, 0] * sizes[0]) ** 2 + (offsets[:, 1] * sizes[1]) ** 2 + (offsets[:, 2] * sizes[2]) ** 2
    for cell in cells:
        nearest, best = -1, reach**2
        for k in range(27):
            if solid[cell + around[k]] and (of_steps[k] < best or (nearest < 0 and of_steps[k] == best)):
                nearest, best = k, of_steps[k]
        if nearest < 0:
            continue
        own = ranks[nodes[cell]] = len(voxels)
        voxels.append(np.int64(cell))
        waiting.append(np.int64(own))
        if len(voxels) > len(squares):
            squares, ways = np.concatenate((squares, squares)), np.concatenate((ways, ways))
        squares[own] = best
        for axis in range(3):
            ways[own, axis] = -offsets[nearest, axis]
    if reach < 2 * sizes.min():
        return np.array(voxels), np.sqrt(squares[: len(voxels)])
    is_waiting = np.ones(len(squares), np.bool_)
    n_seen = 0
    while n_seen < len(waiting):
        row = waiting[n_seen]
        n_seen, is_waiting[row], voxel = n_seen + 1, False, voxels[row]
        for k in range(27):
            x, y, z = ways[row, 0] + offsets[k, 0], ways[row, 1] + offsets[k, 1], ways[row, 2] + offsets[k, 2]
            square = (x * sizes[0]) ** 2 + (y * sizes[1]) ** 2 + (z * sizes[2]) ** 2
            if square > reach**2:
                continue
            other = voxel + around[k]
            own = ranks[nodes[other]]
            if own == _ELSEWHERE:
                continue
            if own == _FREE:
                own = ranks[nodes[other]] = len(voxels)
                voxels.append(other)
                if len(voxels) > len(squares):
                    squares, ways = np.concatenate((squares, squares)), np.concatenate((ways, ways))
                    is_waiting = np.concatenate((is_waiting, is_waiting))
                squares[own], is_waiting[own] = np.inf, False
            if square < squares[own]:
                squares[own], ways[own, 0], ways[own, 1], ways[own, 2] = square, x, y, z
                if not is_waiting[own]:
                    is_waiting[own] = True
                    waiting.append(np.int64(own))
    return np.array(voxels), np.sqrt(squares[: len(voxels)])


@compiled
def _means(
    solid: Counts, nodes: Nodes, ranks: Ranks, voxels: Indices, distances: Floats, around: Integers, reach: float
) -> Floats:
    """Means (N,) of the distances around each of some voxels."""
    means = np.zeros(len(voxels))
    for row in range(len(voxels)):
        for step in around:
            other = voxels[row] + step
            own = ranks[nodes[other]]
            if own >= 0:
                means[row] += distances[own] / 27
            elif not solid[other]:
                means[row] += reach / 27
    return means
