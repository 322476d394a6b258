"""Straightened loops: as long as closed geodesics, on strips as on the whole surface, and on the surface itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from topokit.core.handles import straightening
from topokit.core.handles.straightening import straightened
from topokit.testing import torus_mesh


def length(polygon: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1).sum())


@pytest.mark.parametrize("whole", [50_000, 0], ids=["whole", "strips"])
def test_wavy_loops_of_a_torus_become_its_shortest_circles(whole: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(straightening, "_WHOLE", whole)
    monkeypatch.setattr(straightening, "_FIRST_RINGS", 1)
    vertices, faces = torus_mesh(96, 48, major=1, minor=0.3)
    steps = np.arange(96)
    top = steps * 48 + 12 + (steps % 8 > 3)  # over the top, which is no geodesic: it slides to the inner equator
    tube = 48 * 7 + np.arange(48)
    long, short = straightened(vertices, faces, [top, tube])
    assert length(long) == pytest.approx(2 * math.pi * 0.7, rel=2e-3)
    assert length(short) == pytest.approx(2 * math.pi * 0.3, rel=2e-3)
    distance = np.hypot(np.hypot(long[:, 0], long[:, 1]) - 1, long[:, 2])
    assert np.abs(distance - 0.3).max() < 2e-3
    assert np.hypot(long[:, 0], long[:, 1]).max() < 0.71
