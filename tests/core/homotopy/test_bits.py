"""Solids as bits against the same on arrays of voxels."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import maximum_filter1d

from topokit.core.homotopy.bits import are_set, changes, packed, voxels_of, widened


@pytest.mark.parametrize("length", [3, 64, 70, 200])
def test_packed_voxels_come_back(length: int) -> None:
    solid = np.random.default_rng(length).random((4, 5, length)) < 0.3
    assert np.array_equal(voxels_of(packed(solid), length), np.flatnonzero(solid))


@pytest.mark.parametrize("length", [3, 64, 70, 200])
def test_single_voxels_and_where_rows_change(length: int) -> None:
    draw = np.random.default_rng(length)
    solid = draw.random((4, 5, length)) < 0.5
    some = draw.integers(0, solid.size, 100)
    assert np.array_equal(are_set(packed(solid), some, length), solid.ravel()[some])
    is_new = np.pad(solid[:, :, 1:] != solid[:, :, :-1], ((0, 0), (0, 0), (1, 0)), constant_values=True)
    assert np.array_equal(voxels_of(changes(packed(solid), length), length), np.flatnonzero(is_new))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("steps", [0, 1, 3, 5, 64, 70])
def test_widening_is_that_of_voxels(axis: int, steps: int) -> None:
    solid = np.random.default_rng(steps).random((9, 8, 150)) < 0.02
    both = maximum_filter1d(solid, 2 * steps + 1, axis=axis, mode="constant")
    found = voxels_of(widened(packed(solid), axis, steps, steps), 192)
    assert np.array_equal(found[found % 192 < 150], np.flatnonzero(np.pad(both, ((0, 0), (0, 0), (0, 42)))))
    before = np.roll(np.pad(solid, [(steps, steps)] * 3), steps, axis)  # of one voxel, the one so many steps after it
    one_way = voxels_of(widened(packed(solid), axis, steps, 0), 192)
    inner = tuple(slice(steps, steps + n) for n in solid.shape)
    assert set(np.flatnonzero(np.pad(before[inner], ((0, 0), (0, 0), (0, 42))))) <= set(one_way.tolist())
