"""What some voxels do to the topology of a solid when they change sides, from their surroundings alone."""

from __future__ import annotations

from topokit.core.arrays import Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.blocks.links import completed
from topokit.core.blocks.planes import root_of
from topokit.core.homotopy.growth import Nodes
from topokit.core.homotopy.simple_points import Counts, Indices, code_at, exchanged, touching


@compiled
def flip(inside: Counts, voxels: Indices, around: Integers, connectivity: int) -> int:
    """Flip voxels, in place, and return by how much the Euler characteristic of the solid changes.

    Args:
        inside: (M,) 1 inside, flat.
        voxels: (N,) flat indices.
        around: (27,) steps to the neighbors of a voxel.
        connectivity: 6 or 26, that of the solid.
    """
    change = 0
    for voxel in voxels:
        code = code_at(inside, voxel, around) | 1 << 13
        if connectivity == 26:
            code = exchanged(code) | 1 << 13
        own = completed(code) if connectivity == 6 else -completed(code)
        change += -own if inside[voxel] else own
        inside[voxel] ^= 1
    return change


@compiled
def effect(
    solid: Counts, voxels: Indices, nodes: Nodes, parts: Nodes, holes: Nodes, around: Integers, connectivity: int
) -> tuple[int, int, int]:
    """How many parts some voxels join, tunnels they close and cavities they fill, if they alone join a solid.

    Parts and cavities follow from the regions around and within, tunnels from the Euler characteristic, which is local.
    A cavity that is walled off counts as a tunnel: only a count of the whole solid tells them apart.

    Args:
        solid: (M,) 1 inside, flat; the same again afterwards.
        voxels: (N,) flat indices of voxels of the background.
        nodes: (M,) of the voxels; see `Zone`.
        parts: forest of the regions of the solid.
        holes: forest of those of the background.
        around: (27,) steps to the neighbors of a voxel.
        connectivity: 6 or 26, that of the solid.
    """
    change = flip(solid, voxels, around, connectivity)
    is_added = set(voxels)
    touched, beside, within = {0}, {0}, {0}
    of_solid, of_background = touching(exchanged(0), connectivity), touching(exchanged(0), 32 - connectivity)
    for voxel in voxels:
        within.add(int(root_of(holes, nodes[voxel])))
        for k in range(27):
            other = voxel + around[k]
            if solid[other]:
                if of_solid >> k & 1 and other not in is_added:
                    touched.add(int(root_of(parts, nodes[other])))
            elif of_background >> k & 1:
                beside.add(int(root_of(holes, nodes[other])))
    flip(solid, voxels, around, connectivity)
    joined, filled = len(touched) - 2, len(within - beside)
    return joined, change + joined + filled, filled
