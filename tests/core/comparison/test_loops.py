"""Loops around the tunnels in which two solids differ: all are found, they are closed, in their solid, and short."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from topokit.core.comparison.cells import FIRST, SECOND
from topokit.core.comparison.loops import differing_loops
from topokit.core.comparison.pair import SolidPair

SHORTEST = {6: 8, 26: 4}  # around a pinhole of one voxel: through the centers around it, or its corners


@pytest.mark.parametrize("connectivity", [6, 26])
def test_every_tunnel_that_differs_has_a_loop(connectivity: int) -> None:
    generator = np.random.default_rng(1)
    one, noise = (gaussian_filter(generator.standard_normal((24, 22, 20)), 1.2) for _ in range(2))
    pair = SolidPair(one > 0.3 * one.std(), one / one.std() + 0.7 * noise / noise.std() > 0.3, connectivity)
    tunnels, n_steps = pair.tunnels, 0
    for side, solid in ((0, FIRST), (1, SECOND)):
        found = list(differing_loops(pair.complex, solid, 100))
        n_filled = tunnels.betti[side] - tunnels.surviving[side]
        assert Counter(loop.kind for loop in found) == {
            "filled": n_filled,
            "absent": tunnels.surviving[side] - tunnels.matched,
        }
        for loop in found:
            steps = np.abs(np.roll(loop.vertices, -1, 0) - loop.vertices)
            assert (steps.sum(1) == 1).all()
            assert len(np.unique(loop.vertices, axis=0)) == len(loop.vertices)
            assert _is_inside(loop.vertices, (pair.first, pair.second)[side], connectivity)
            n_steps += len(steps)
    assert n_steps > 100


@pytest.mark.parametrize("connectivity", [6, 26])
def test_loops_are_as_short_as_can_be(connectivity: int) -> None:
    """Pinholes in a plate that is bent to a long tunnel, of which the other solid has only one half."""
    tube = np.zeros((60, 20, 20), bool)
    tube[1:-1, 1:-1, 1:-1] = True
    tube[1:-1, 4:-4, 4:-4] = False
    pierced, half = tube.copy(), tube.copy()
    for x in (5, 9, 30, 41, 55):
        pierced[x, 10, 1:4] = False
    half[:, 10:] = False
    found = list(differing_loops(SolidPair(pierced, tube, connectivity).complex, FIRST, 100))
    assert [len(loop.vertices) for loop in found] == [SHORTEST[connectivity]] * 5
    [around] = differing_loops(SolidPair(tube, half, connectivity).complex, FIRST, 100)
    assert len(around.vertices) == {6: 4 * 13, 26: 4 * 12}[connectivity]


def _is_inside(vertices, solid, connectivity: int) -> bool:
    """Whether vertices are centers of voxels of a solid, or corners of any."""
    shifts = [0] if connectivity == 6 else [-0.5, 0.5]
    corners = np.stack(np.meshgrid(shifts, shifts, shifts), -1).reshape(-1, 3)
    voxels = (vertices[:, None] + corners).astype(int) + 1
    return bool(np.pad(solid, 1)[tuple(np.moveaxis(voxels, -1, 0))].any(axis=1).all())
