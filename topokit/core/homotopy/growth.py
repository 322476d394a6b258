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
from topokit.core.blocks.planes import root_of
from topokit.core.homotopy.simple_points import OFFSETS, Counts, Indices, component, n_touching, touching

Ranks = NDArray[np.int32]


def strides_around(shape: tuple[int, ...]) -> Integers:
    """Steps (27,) in the flat array of a grid to the voxels around one, in the order of `OFFSETS`."""
    steps: Integers = OFFSETS @ np.array([shape[1] * shape[2], shape[2], 1])
    return steps


@compiled
def grow(inside: Counts, order: Indices, rank: Ranks, around: Integers, connectivity: int) -> None:
    """Flip voxels in an order as long as each is simple; a neighbor that becomes simple later is flipped then.

    Args:
        inside: (M,) 1 inside, flat, with a layer around it that is not flipped; changed in place.
        order: (N,) flat indices of the voxels to flip, each once.
        rank: (M,) memory to work in, negative; it is negative again afterwards.
        around: (27,) steps to the neighbors of a voxel.
        connectivity: 6 or 26, that of the solid.
    """
    for place in range(len(order)):
        rank[order[place]] = place
    seen = place = 0
    again = [np.int64(0) for _ in range(0)]
    while seen < len(order) or again:
        if again:
            place = int(heappop(again))
        else:
            place, seen = seen, seen + 1
        voxel = order[place]
        if rank[voxel] < 0:
            continue
        code = code_at(inside, voxel, around)
        if n_touching(code, connectivity) != 1 or n_touching(~code & 0x7FFFFFF, 32 - connectivity) != 1:
            continue
        inside[voxel] ^= 1
        rank[voxel] = -1
        for step in around:
            if 0 <= rank[voxel + step] < seen:
                heappush(again, np.int64(rank[voxel + step]))
    for voxel in order:
        rank[voxel] = -1


@compiled
def code_at(inside: Counts, voxel: int, around: Integers) -> int:
    """The neighborhood of a voxel as a code of 27 bits."""
    code = 0
    for bit in range(27):
        code |= int(inside[voxel + around[bit]]) << bit
    return code


@compiled
def numbers_at(inside: Counts, voxels: Indices, around: Integers, connectivity: int) -> tuple[Counts, Counts]:
    """Components of the solid and of the background (N,) that touch each of some voxels."""
    solid, background = np.empty(len(voxels), dtype=np.int8), np.empty(len(voxels), dtype=np.int8)
    for row in range(len(voxels)):
        code = code_at(inside, voxels[row], around)
        solid[row] = n_touching(code, connectivity)
        background[row] = n_touching(~code & 0x7FFFFFF, 32 - connectivity)
    return solid, background


@compiled
def joins(inside: Counts, labels: Ranks, voxels: Indices, around: Integers, connectivity: int) -> Counts:
    """Add voxels one after the other if each only joins components that were apart, as Kruskal's algorithm does.

    Args:
        inside: (M,) 1 inside; changed in place.
        labels: (M,) the component of each voxel inside, from 1 on; changed in place.
        voxels: (N,) flat indices, in the order in which they are tried.
        around: (27,) steps to the neighbors of a voxel.
        connectivity: 6 or 26, that of the solid.

    Returns:
        (N,) how many components each voxel joined, −1 where it would have closed a loop and was not added.
    """
    parent = np.arange(labels.max() + len(voxels) + 1)
    n_joined = np.full(len(voxels), -1, dtype=np.int8)
    for row in range(len(voxels)):
        voxel = voxels[row]
        code = code_at(inside, voxel, around)
        left, own, is_loop = touching(code, connectivity), len(parent) - 1 - row, False
        roots = [0 for _ in range(0)]
        while left:
            one = left & -left
            bit = 0
            while one >> bit > 1:
                bit += 1
            root = root_of(parent, labels[voxel + around[bit]])
            is_loop |= root in roots
            roots.append(root)
            left &= ~component(code, one, connectivity)
        if not is_loop:
            for root in roots:
                parent[root] = own
            labels[voxel], inside[voxel], n_joined[row] = own, 1, len(roots)
    return n_joined
