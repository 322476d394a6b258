"""Narrow places: in the middle of gaps, channels and bubbles, and not beside walls, edges and slopes."""

from __future__ import annotations

import numpy as np
import pytest

from topokit.core.homotopy.narrow import narrow_voxels

N = 30
X, Y, Z = np.meshgrid(*[np.arange(N)] * 3, indexing="ij")
ONE = (1.0, 1.0, 1.0)


def found(solid: np.ndarray, reach: float = 3.87) -> np.ndarray:
    voxels, distances = narrow_voxels(solid, reach, ONE, 26)
    assert len(voxels) == len(distances)
    return np.stack(np.unravel_index(voxels, solid.shape), axis=1)


@pytest.mark.parametrize("width", [1, 2, 3, 4, 5, 6])
def test_the_middle_of_a_channel_a_gap_and_a_bubble_is_narrow(width: int) -> None:
    whole = (abs(X - 15) <= 8) & (abs(Y - 15) <= 8) & (abs(Z - 15) <= 8)
    start = 15 - width // 2
    a, b, c = ((one >= start) & (one < start + width) for one in (X, Y, Z))
    middle = start + (width - 1) / 2
    for empty, axes in ((a, [0]), (a & b, [0, 1]), (a & b & c, [0, 1, 2])):
        at = found(whole & ~empty)
        core = at[(abs(at - 15) <= 5).all(axis=1)]
        assert len(core)
        assert abs(core[:, axes] - middle).max() <= 1
        assert abs(core[:, axes] - middle).min() <= 0.5


@pytest.mark.parametrize("solid", [Z < 15, (Z < 15) | (X < 15), X + Z < 30, X + Y + Z < 45], ids=str)
def test_beside_walls_edges_and_slopes_nothing_is(solid: np.ndarray) -> None:
    assert len(found(solid)) == 0
    assert len(found(~solid)) == 0


def test_around_a_wide_ball_nothing_is() -> None:
    ball = (X - 15) ** 2 + (Y - 15) ** 2 + (Z - 15) ** 2 <= 81
    assert len(found(ball, 1.87)) == 0
