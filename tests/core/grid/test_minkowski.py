"""Minkowski numbers of solids whose numbers are known, in cubic and in long voxels."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from topokit.core.grid import minkowski
from topokit.core.grid.euler import solid_euler
from topokit.core.grid.minkowski import cube_counts, euler_of, minkowski_numbers

SPACINGS = [(1.0, 1.0, 1.0), (1.0, 0.7, 1.6)]


def measured(solid, half: float, spacing: tuple[float, float, float], connectivity: int):
    """The numbers of {p: solid(p)} in a cube of some half side, sampled at the centers of voxels."""
    axes = [np.arange(-half, half, step) + 0.31 * step for step in spacing]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    return minkowski_numbers(cube_counts(np.pad(solid(points), 1)), connectivity, spacing)


def cylinder(points: np.ndarray) -> np.ndarray:
    """Radius 12, height 40, around an oblique axis."""
    x, y, z = np.moveaxis(points @ Rotation.from_euler("xyz", (0.4, 0.7, 0.2)).as_matrix(), -1, 0)
    return (np.hypot(x, y) < 12) & (abs(z) < 20)


def ring(points: np.ndarray) -> np.ndarray:
    """A torus with radii 18 and 7."""
    x, y, z = np.moveaxis(points @ Rotation.from_euler("xyz", (0.4, 0.7, 0.2)).as_matrix(), -1, 0)
    return np.hypot(np.hypot(x, y) - 18, z) < 7


SOLIDS = {  # half side, volume, area, mean breadth, χ
    "ball": (lambda p: np.linalg.norm(p, axis=-1) < 15, 18, (4 / 3 * pi * 15**3, 4 * pi * 15**2, 30, 1)),
    "cylinder": (cylinder, 26, (pi * 144 * 40, 24 * pi * (12 + 40), (40 + 12 * pi) / 2, 1)),
    "ring": (ring, 28, (2 * pi**2 * 18 * 49, 4 * pi**2 * 18 * 7, 18 * pi, 0)),
}


@pytest.mark.parametrize("spacing", SPACINGS)
@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("name", SOLIDS)
def test_numbers_of_known_solids(name: str, connectivity: int, spacing: tuple[float, float, float]) -> None:
    solid, half, (volume, area, breadth, euler) = SOLIDS[name]
    found = measured(solid, half, spacing, connectivity)
    assert found.volume == pytest.approx(volume, rel=0.01)
    assert found.surface_area == pytest.approx(area, rel=0.025)
    assert found.mean_breadth == pytest.approx(breadth, rel=0.05)
    assert found.euler == euler


def test_a_box_along_the_axes_is_the_worst_case() -> None:
    box = np.pad(np.ones((20, 30, 40), bool), 1)
    found = minkowski_numbers(cube_counts(box), 26, (1.0, 1.0, 1.0))
    assert found.volume == 20 * 30 * 40
    assert found.surface_area == pytest.approx(2 * (600 + 800 + 1200), rel=0.1)
    assert found.mean_breadth == pytest.approx(45, rel=0.1)


def test_shares_of_directions_in_cubic_voxels_are_the_published_ones() -> None:
    shares = minkowski._shares(minkowski._DIRECTIONS.astype(float))
    published = {1: 0.04577789120476, 2: 0.03698062787608, 3: 0.03519563978232}  # Legland et al., of one sense
    expected = [2 * published[int(abs(way).sum())] for way in minkowski._DIRECTIONS]
    np.testing.assert_allclose(shares, expected, rtol=1e-6)


@pytest.mark.parametrize("connectivity", [6, 26])
def test_euler_characteristic_is_that_of_the_count(connectivity: int) -> None:
    for seed in range(5):
        inside = np.random.default_rng(seed).random((7, 8, 9)) < 0.2 + 0.15 * seed
        counts = cube_counts(np.pad(inside, 1))
        assert counts.sum() == 8 * 9 * 10
        assert euler_of(counts, connectivity) == int(solid_euler(inside, 0, connectivity))
