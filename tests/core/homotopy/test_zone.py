"""Regions by runs and by the voxels of a zone against SciPy's labels; what flips do against whole counts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import label

from topokit.core.grid.betti import betti_numbers
from topokit.core.grid.euler import solid_euler
from topokit.core.homotopy.effects import effect, flip
from topokit.core.homotopy.growth import strides_around
from topokit.core.homotopy.runs import ELSEWHERE, labeled
from topokit.core.homotopy.zone import Zone

CORNERS = np.ones((3, 3, 3))


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("seed", range(12))
def test_regions_by_runs_are_those_of_labels(seed: int, connectivity: int) -> None:
    draw = np.random.default_rng(seed)
    shape = draw.integers(1, 14, 3)
    states = draw.choice([0, 1, ELSEWHERE], size=shape, p=[0.45, 0.35, 0.2]).astype(np.uint8)
    left_out = states == ELSEWHERE
    solid = (states == 1) | (left_out & (draw.random(shape) < 0.5))
    nodes, own = labeled(solid, np.flatnonzero(left_out), connectivity)
    for phase in (0, 1):
        chosen = states == phase
        structure = CORNERS if (connectivity == 26) == (phase == 1) else None
        wanted, count = label(chosen, structure)
        pairs = np.unique(np.stack((nodes.reshape(shape)[chosen], wanted[chosen])), axis=1)
        assert pairs.shape[1] == count == len(np.unique(pairs[0])) == (own == phase).sum()
        assert (own[pairs[0]] == phase).all()


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("seed", range(6))
def test_a_zone_counts_the_regions_of_the_whole(seed: int, connectivity: int) -> None:
    draw = np.random.default_rng(seed)
    solid = np.pad(draw.random((12, 11, 13)) < 0.4, 2)
    inner = np.flatnonzero(np.pad(np.ones((12, 11, 13), dtype=bool), 2))
    zone = Zone(solid, np.sort(draw.choice(inner, len(inner) // 3, replace=False)), connectivity)
    inside = solid.ravel().view(np.int8)
    inside[draw.choice(zone.voxels, 50, replace=False)] ^= 1  # regions outside the zone stay
    forests = zone.forest(inside, 1, connectivity), zone.forest(inside, 0, 32 - connectivity)
    pieces, outside = zone.counts(inside, *forests)
    wanted = betti_numbers(solid.astype(float), 0.5, connectivity).tolist()
    assert (pieces, outside - 1) == (wanted[0], wanted[2])


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("seed", range(6))
def test_what_voxels_do_is_what_counting_says(seed: int, connectivity: int) -> None:
    draw = np.random.default_rng(seed)
    solid = np.pad(draw.random((9, 9, 9)) < 0.4, 2)
    inside, around = solid.ravel().view(np.int8), strides_around(solid.shape)
    zone = Zone(solid, np.flatnonzero(np.pad(np.ones((9, 9, 9), dtype=bool), 2)), connectivity)
    forests = zone.forest(inside, 1, connectivity), zone.forest(inside, 0, 32 - connectivity)
    before = betti_numbers(solid.astype(float), 0.5, connectivity).numpy()
    free = zone.voxels[inside[zone.voxels] == 0]
    for voxels in np.split(draw.choice(free, 40, replace=False), [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 20]):
        joined, closed, filled = effect(inside, voxels, zone.nodes, *forests, around, connectivity)
        euler = int(solid_euler(solid, connectivity=connectivity))
        change = flip(inside, voxels, around, connectivity)
        assert euler + change == int(solid_euler(solid, connectivity=connectivity))
        after = betti_numbers(solid.astype(float), 0.5, connectivity).numpy()
        assert change == closed - joined - filled
        walls_off = after[2] + filled > before[2]  # which only counting tells from tunnels that are closed
        assert len(voxels) > 1 or walls_off or (before - after).tolist() == [joined, closed, filled]
        flip(inside, voxels, around, connectivity)
