"""Voxels by the tile of the volume in which they are, so that work beside few of them is not done everywhere."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from topokit.core.arrays import Integers


def tiles_of(voxels: Integers, size: int) -> Iterator[tuple[Integers, Integers]]:
    """The first voxel (3,) of each cubic tile that holds any of some voxels (N, 3), and their rows.

    Args:
        voxels: indices of at least 0.
        size: of a tile, in voxels.
    """
    tiles, own, counts = np.unique(voxels // size, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(own.ravel(), kind="stable")
    for tile, count, stop in zip(tiles, counts, np.cumsum(counts), strict=True):
        yield size * tile, order[stop - count : stop]
