"""Voxels by tile."""

from __future__ import annotations

import numpy as np

from topokit.core.grid.tiles import tiles_of


def test_every_voxel_is_in_one_tile_and_the_order_is_kept() -> None:
    voxels = np.random.default_rng(0).integers(0, 40, (500, 3))
    seen = []
    for first, rows in tiles_of(voxels, 16):
        assert (first % 16 == 0).all()
        assert ((voxels[rows] >= first) & (voxels[rows] < first + 16)).all()
        assert (np.diff(rows) > 0).all()
        seen.append(rows)
    assert len(seen) == 27
    assert np.array_equal(np.sort(np.concatenate(seen)), np.arange(500))


def test_no_voxels_have_no_tile() -> None:
    assert list(tiles_of(np.empty((0, 3), dtype=np.int64), 16)) == []
