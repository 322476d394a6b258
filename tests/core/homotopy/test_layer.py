"""Layers around solids against SciPy's distance transform."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt, gaussian_filter

from topokit.core.homotopy.layer import MARGIN, Box, layer_around

INNER = (slice(MARGIN, -MARGIN),) * 3
EVERYWHERE: list[Box] = [(slice(None), slice(None), slice(None))]


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (1.0, 0.7, 2.0)])
@pytest.mark.parametrize("reach", [1.0, 3.2])
def test_it_holds_the_voxels_within_reach_the_nearest_first(spacing: tuple[float, float, float], reach: float) -> None:
    noise = gaussian_filter(np.random.default_rng(1).normal(size=(26, 24, 22)), 2)
    solid = np.zeros(noise.shape, dtype=bool)
    solid[INNER] = (noise > noise.std())[INNER]
    distance = distance_transform_edt(~solid, spacing)
    voxels, memory = layer_around(solid, EVERYWHERE, reach, spacing)
    assert len(np.unique(voxels)) == len(voxels)
    assert (memory < 0).all()
    is_within = np.zeros(solid.shape, dtype=bool)
    is_within[INNER] = ((distance > 0) & (distance <= reach))[INNER]
    assert is_within.ravel()[voxels].all()
    assert is_within.sum() - len(voxels) <= 0.005 * len(voxels)
    assert np.diff(distance.ravel()[voxels]).min() > -0.2 * min(spacing)


def test_it_stays_in_its_boxes() -> None:
    solid = np.zeros((20, 20, 20), dtype=bool)
    solid[8:12, 8:12, 8:12] = True
    boxes = [(slice(9, 15), slice(9, 11), slice(9, 11)), (slice(0, 20), slice(9, 11), slice(10, 11))]
    voxels, _ = layer_around(solid, boxes, 2.0, (1.0, 1.0, 1.0))
    found = np.stack(np.unravel_index(voxels, solid.shape), axis=1)
    wanted = {(x, y, z) for x in (12, 13) for y in (9, 10) for z in (9, 10)} | {
        (x, y, 10) for x in (6, 7) for y in (9, 10)
    }
    assert {tuple(one) for one in found.tolist()} == wanted


def test_of_equally_near_voxels_the_middle_of_a_gap_comes_first() -> None:
    solid = np.zeros((19, 19, 19), dtype=bool)
    solid[7:12, 7:12, 4:9] = solid[7:12, 7:12, 10:15] = True
    voxels, _ = layer_around(solid, EVERYWHERE, 3.0, (1.0, 1.0, 1.0))
    assert voxels[0] == np.ravel_multi_index((9, 9, 9), solid.shape)


def test_an_empty_solid_has_none() -> None:
    voxels, memory = layer_around(np.zeros((9, 9, 9), dtype=bool), EVERYWHERE, 3.0, (1.0, 1.0, 1.0))
    assert len(voxels) == 0
    assert len(memory) == 9**3
