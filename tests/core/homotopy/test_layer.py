"""Layers around solids against SciPy's distance transform."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt, gaussian_filter

from topokit.core.homotopy.layer import layer_around
from topokit.core.homotopy.zone import Zone

INNER = (slice(2, -2),) * 3


def around(solid: np.ndarray, cells: np.ndarray, reach: float, spacing: tuple[float, float, float]) -> np.ndarray:
    flat = np.flatnonzero(cells & ~solid)
    zone = Zone(solid, flat, 26)
    memory = np.full(zone.n_nodes, -1, dtype=np.int32)
    found = layer_around(solid.ravel().view(np.int8), flat, zone, memory, reach, spacing)
    assert (memory == -1).all()
    assert np.array_equal(np.sort(found.places), np.arange(len(found.voxels)))
    return found.in_order(np.ones(len(found.voxels), dtype=bool))


def inner(shape: tuple[int, ...]) -> np.ndarray:
    cells = np.zeros(shape, dtype=bool)
    cells[INNER] = True
    return cells


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (1.0, 0.7, 2.0)])
@pytest.mark.parametrize("reach", [1.0, 3.2])
def test_it_holds_the_voxels_within_reach_the_nearest_first(spacing: tuple[float, float, float], reach: float) -> None:
    noise = gaussian_filter(np.random.default_rng(1).normal(size=(26, 24, 22)), 2)
    solid = inner(noise.shape) & (noise > noise.std())
    distance = distance_transform_edt(~solid, spacing)
    voxels = around(solid, inner(solid.shape), reach, spacing)
    assert len(np.unique(voxels)) == len(voxels)
    is_within = inner(solid.shape) & (distance > 0) & (distance <= reach)
    assert is_within.ravel()[voxels].all()
    assert is_within.sum() - len(voxels) <= 0.005 * len(voxels)
    assert np.diff(distance.ravel()[voxels]).min() > -0.2 * min(spacing)


def test_it_holds_no_other_voxels_than_those_given() -> None:
    solid, cells = np.zeros((20, 20, 20), dtype=bool), np.zeros((20, 20, 20), dtype=bool)
    solid[8:12, 8:12, 8:12] = True
    cells[9:15, 9:11, 9:11] = cells[2:18, 9:11, 10:11] = True
    voxels = around(solid, cells, 2.0, (1.0, 1.0, 1.0))
    found = np.stack(np.unravel_index(voxels, solid.shape), axis=1)
    wanted = {(x, y, z) for x in (12, 13) for y in (9, 10) for z in (9, 10)} | {
        (x, y, 10) for x in (6, 7) for y in (9, 10)
    }
    assert {tuple(one) for one in found.tolist()} == wanted


def test_of_equally_near_voxels_the_middle_of_a_gap_comes_first() -> None:
    solid = np.zeros((19, 19, 19), dtype=bool)
    solid[7:12, 7:12, 4:9] = solid[7:12, 7:12, 10:15] = True
    voxels = around(solid, inner(solid.shape), 3.0, (1.0, 1.0, 1.0))
    assert voxels[0] == np.ravel_multi_index((9, 9, 9), solid.shape)


def test_an_empty_solid_has_none() -> None:
    solid = np.zeros((9, 9, 9), dtype=bool)
    assert len(around(solid, inner(solid.shape), 3.0, (1.0, 1.0, 1.0))) == 0
