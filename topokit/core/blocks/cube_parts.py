"""How often each cube of 2 × 2 × 2 voxels occurs in a box of a volume, block by block; see `minkowski.cube_counts`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from topokit.core.arrays import Booleans, Integers
from topokit.core.blocks.division import Box
from topokit.core.grid.minkowski import cube_counts


@dataclass(frozen=True, eq=False)
class CubePart:
    """The cubes of a box.

    Attributes:
        counts: (256,).
        faces: for each axis, which voxels of the first and of the last layer are in the solid.
    """

    counts: Integers
    faces: tuple[tuple[Booleans, Booleans], ...]


def count_cube_part(inside: Booleans, box: Box, shape: Sequence[int], has_layer: Sequence[bool]) -> CubePart:
    """The part of one block.

    Args:
        inside: (X, Y, Z), whether a voxel of the block is in the solid.
        box: of the block in the volume, first and last + 1 voxel along each axis.
        shape: of the volume.
        has_layer: for each axis, whether there is a layer of background beyond both ends of the volume.
    """
    layers = [(int(has and a == 0), int(has and b == n)) for has, (a, b), n in zip(has_layer, box, shape, strict=True)]
    solid = np.pad(inside, layers)
    faces = tuple((np.take(solid, 0, axis), np.take(solid, -1, axis)) for axis in range(3))
    return CubePart(cube_counts(solid), faces)


def join_cube_parts(one: CubePart, other: CubePart, axis: int) -> CubePart:
    """The part of two boxes, of which the other comes next along an axis."""
    between = cube_counts(np.stack((one.faces[axis][1], other.faces[axis][0]), axis))
    faces = [
        (mine[0], theirs[1])
        if number == axis
        else tuple(np.concatenate(ends, axis - (axis > number)) for ends in zip(mine, theirs, strict=True))
        for number, (mine, theirs) in enumerate(zip(one.faces, other.faces, strict=True))
    ]
    return CubePart(one.counts + other.counts + between, tuple(faces))  # type: ignore[arg-type]
