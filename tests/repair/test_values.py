"""Values of voxels that change sides."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt

from topokit.repair.volumes import with_values_of_the_nearest


def test_they_are_those_of_the_nearest_voxel_on_the_other_side() -> None:
    draw = np.random.default_rng(0)
    before = np.zeros((40, 20, 20), dtype=bool)
    before[20:] = draw.random((20, 20, 20)) > 0.1  # outside, some are far from the solid
    after = before ^ (draw.random(before.shape) < 0.05)
    names = np.arange(before.size).reshape(before.shape)
    values = with_values_of_the_nearest(names, before, np.argwhere(before != after))
    assert np.array_equal(values[before == after], names[before == after])
    for side in (before, ~before):
        changed = np.argwhere(side & (before != after))
        source = np.stack(np.unravel_index(values[tuple(changed.T)], before.shape), axis=1)
        assert not side[tuple(source.T)].any()
        away = distance_transform_edt(side)[tuple(changed.T)]
        assert np.allclose(np.linalg.norm(source - changed, axis=1), away)


def test_not_a_number_is_taken_over_only_if_there_is_nothing_else() -> None:
    before = np.zeros((9, 9, 9), dtype=bool)
    before[2:7, 2:7, 2:7] = True
    values = np.where(before, 1.0, np.nan)
    corner = np.array([[2, 2, 2]])
    assert np.isnan(with_values_of_the_nearest(values, before, corner)[2, 2, 2])
    values[8, 8, 8] = -3.0
    assert with_values_of_the_nearest(values, before, corner)[2, 2, 2] == -3.0
    values[~before] = np.where(values[~before] == -3.0, -3.0, -np.inf)
    assert with_values_of_the_nearest(values, before, corner)[2, 2, 2] == -np.inf
