"""Ordered homotopic growth: voxels change sides one after the other, each only if it is simple when its turn comes.

Reference:
    C. Pudney, "Distance-ordered homotopic thinning", CVIU 72, 1998, doi:10.1006/cviu.1998.0680.
"""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.homotopy.simple_points import (
    OFFSETS,
    Counts,
    Indices,
    code_at,
    exchanged,
    is_simple_in,
    n_touching,
    touching,
)

Ranks = NDArray[np.int32]
Nodes = NDArray[np.int32]

_KNOWN = 1 << 15  # neighborhoods that are remembered
_SPREAD = 0x9E3779B1  # an odd number, by which they are spread over places
_AROUND = 0x7FFFFFF - (1 << 13)


def strides_around(shape: tuple[int, ...]) -> Integers:
    """Steps (27,) in the flat array of a grid to the voxels around one, in the order of `OFFSETS`."""
    steps: Integers = OFFSETS @ np.array([shape[1] * shape[2], shape[2], 1])
    return steps


@compiled
def grow(
    inside: Counts, order: Indices, nodes: Nodes, rank: Ranks, around: Integers, connectivity: int, parents: Nodes
) -> None:
    """Flip voxels in an order as long as each is simple; a neighbor that becomes simple later is flipped then.

    Args:
        inside: (M,) 1 inside, flat, with a layer around it that is not flipped; changed in place.
        order: (N,) flat indices of the voxels to flip, each once.
        nodes: (M,) a number for each voxel; that of a voxel to flip is its own.
        rank: (K,) of the numbers, memory to work in, negative; it is negative again afterwards.
        around: (27,) steps to the neighbors of a voxel.
        connectivity: 6 or 26, that of the solid.
        parents: forest of the nodes, in which voxels that join the solid are hung below a neighbor; of length 0 if none
            is needed.
    """
    for place in range(len(order)):
        rank[nodes[order[place]]] = place
    known = np.full(_KNOWN, -1)
    seen = place = 0
    again = [np.int64(0) for _ in range(0)]
    while seen < len(order) or again:
        if again:
            place = int(heappop(again))
        else:
            place, seen = seen, seen + 1
        voxel = order[place]
        if rank[nodes[voxel]] < 0:
            continue
        code = code_at(inside, voxel, around)
        if not _is_simple(code, connectivity, known):
            continue
        if len(parents) > 0:
            parents[nodes[voxel]] = nodes[voxel + around[first_bit(touching(code & _AROUND, connectivity))]]
        inside[voxel] ^= 1
        rank[nodes[voxel]] = -1
        for step in around:
            own = rank[nodes[voxel + step]]
            if 0 <= own < seen:
                heappush(again, np.int64(own))
    for voxel in order:
        rank[nodes[voxel]] = -1


@compiled
def _is_simple(code: int, connectivity: int, known: Integers) -> bool:
    """Whether a voxel with some neighborhood may be flipped, as `known` remembers it of many neighborhoods."""
    code &= _AROUND
    place = code * _SPREAD >> 27 & (_KNOWN - 1)
    if known[place] >> 1 != code:
        known[place] = code << 1 | is_simple_in(code, connectivity)
    return bool(known[place] & 1)


@compiled
def first_bit(code: int) -> int:
    """The number of the lowest bit that is set."""
    bit = 0
    while not code >> bit & 1:
        bit += 1
    return bit


@compiled
def numbers_at(inside: Counts, voxels: Indices, around: Integers, connectivity: int) -> tuple[Counts, Counts]:
    """Components of the solid and of the background (N,) that touch each of some voxels."""
    solid, background = np.empty(len(voxels), dtype=np.int8), np.empty(len(voxels), dtype=np.int8)
    for row in range(len(voxels)):
        code = code_at(inside, voxels[row], around)
        solid[row] = n_touching(code, connectivity)
        background[row] = n_touching(exchanged(code), 32 - connectivity)
    return solid, background
