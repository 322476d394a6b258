"""Two sheets that normals take for one, against noise of the same thickness."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from topokit.core.cloud.normals.double_sheets import double_share
from topokit.core.cloud.normals.patches import patches_of, unit
from topokit.core.cloud.sampling.cube_hierarchy import curve_order
from topokit.core.cloud.settings import CloudSettings

Floats = NDArray[np.float64]
SETTINGS = CloudSettings()
COUNT = 4_000
SPACING = float(np.sqrt(4 * np.pi / COUNT))  # of one unit sphere


def directions() -> Floats:
    found = unit(np.random.default_rng(0).normal(size=(COUNT, 3)))
    return found[curve_order(found)[0]]


def share(points: Floats, normals: Floats) -> float:
    return double_share(patches_of(points, SETTINGS.patches), 1_000, SETTINGS.doubles, normals)


@pytest.mark.parametrize("spacings", [0.0, 0.2, 0.6, 1.0])
def test_noise_has_one_peak(spacings: float) -> None:
    normals = directions()
    noise = np.random.default_rng(1).normal(size=(COUNT, 3)) * spacings * SPACING
    assert share(normals + noise, normals) < 0.03


@pytest.mark.parametrize("wall", [0.7, 1.0, 1.4])
def test_two_sheets_show_unless_their_normals_tell_them_apart(wall: float) -> None:
    normals = directions()
    is_inner = np.random.default_rng(2).random((COUNT, 1)) < 0.5
    points = normals * np.where(is_inner, 1 - wall * SPACING, 1.0)
    assert share(points, normals) > 0.7
    assert share(points, np.where(is_inner, -normals, normals)) < 0.03


def test_neighbors_on_a_line_are_no_sheets() -> None:
    t = np.linspace(0, 1, 200)[:, None]
    points = np.hstack((t, 0.1 * t**2, 0 * t)) + 1e-3 * np.random.default_rng(3).normal(size=(200, 3))
    assert 0 <= share(points, np.tile([0.0, 0.0, 1.0], (200, 1))) <= 1
