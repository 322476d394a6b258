"""Copies of points: exact and near ones are one place, clouds without copies stay as they are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from topokit.core.cloud.sampling.copies import distinct, places
from topokit.core.cloud.sampling.downsampling import downsample
from topokit.testing import sphere_samples

Floats = NDArray[np.float64]


def random_sphere(n_points: int) -> Floats:
    direction = np.random.default_rng(0).normal(size=(n_points, 3))
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


def scan_lines(jitter: float) -> Floats:
    """Points 20 times as near along the lines as the lines are to each other."""
    points = np.stack(np.meshgrid(np.arange(0, 20, 0.05), np.arange(20.0), [0.0]), axis=-1).reshape(-1, 3)
    points[:, 0] += np.random.default_rng(0).uniform(-jitter, jitter, len(points))
    return points


def spread_sphere(n_points: int) -> Floats:
    many = random_sphere(20 * n_points)
    return many[downsample(many, n_points, "even")[0]]


CLEAN: dict[str, Callable[[], Floats]] = {
    "random": lambda: random_sphere(5000),
    "random, single precision": lambda: random_sphere(5000).astype(np.float32).astype(np.float64),
    "many": lambda: random_sphere(200_000),
    "spread": lambda: spread_sphere(1000),
    "grid": lambda: np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0), [0.0]), axis=-1).reshape(-1, 3),
    "noise": lambda: np.random.default_rng(0).normal(size=(3000, 3)),
    "random points of a line": lambda: np.random.default_rng(0).normal(size=(3000, 1)) * [1.0, 2.0, 3.0],
    "scan lines": lambda: scan_lines(0),
    "uneven scan lines": lambda: scan_lines(0.02),
    "thirty points": lambda: random_sphere(30),
    "three points": lambda: random_sphere(3),
    "no points": lambda: random_sphere(0),
}


@pytest.mark.parametrize("name", CLEAN)
def test_clouds_without_copies_stay_as_they_are(name: str) -> None:
    count = len(CLEAN[name]())
    first, owner = places(CLEAN[name]())
    np.testing.assert_array_equal(first, np.arange(count))
    np.testing.assert_array_equal(owner, np.arange(count))


@pytest.mark.parametrize("name", ["spread", "grid", "scan lines"])
@pytest.mark.parametrize("n_copies", [2, 8])
@pytest.mark.parametrize("jitter", [0.0, 1e-9, 1e-4])
def test_copies_are_one_place_each(name: str, n_copies: int, jitter: float) -> None:
    clean = CLEAN[name]()
    generator = np.random.default_rng(1)
    number = generator.permutation(np.repeat(np.arange(len(clean)), n_copies))
    first, owner = places(clean[number] + jitter * generator.normal(size=(len(number), 3)))
    assert len(first) == len(clean)
    np.testing.assert_array_equal(number[first][owner], number)
    assert (np.diff(first) > 0).all()
    np.testing.assert_array_equal(first, np.unique(number, return_index=True)[1][number[first]])


def test_more_exact_copies_than_neighbors_are_one_place() -> None:
    points = random_sphere(500)
    assert len(places(np.concatenate((points, points[:5].repeat(400, axis=0))))[0]) == 500


def test_copies_among_more_points_than_are_looked_at_at_once() -> None:
    side = np.arange(200.0)
    grid = np.stack(np.meshgrid(side, side, [0.0]), axis=-1).reshape(-1, 3)
    number = np.random.default_rng(0).permutation(np.repeat(np.arange(len(grid)), 2))
    first, owner = places(grid[number] + 1e-6 * np.random.default_rng(1).normal(size=(len(number), 3)))
    assert len(first) == len(grid)
    np.testing.assert_array_equal(number[first][owner], number)


def test_few_random_points_are_lost_to_near_copies() -> None:
    points = random_sphere(5000)
    first, _ = places(np.concatenate((points, points + 1e-9)))
    assert 4600 <= len(first) < 5000


def test_two_sides_of_a_thin_wall_are_two_places() -> None:
    points = normals = spread_sphere(3000)
    count = len(points)
    wall = np.concatenate((points, points - 1e-4 * normals))
    assert len(places(wall, np.concatenate((normals, -normals)))[0]) == 2 * count
    assert len(places(wall, np.concatenate((normals, normals)))[0]) == len(places(wall)[0]) == count


def test_distinct_positions_and_who_shares_them() -> None:
    points = sphere_samples(500).points.numpy()
    points[0, 0] = 0.0
    repeated = np.concatenate((points, points[:100], points[:1] * [-1.0, 1, 1]))  # −0 is 0
    first, owner = distinct(repeated)
    np.testing.assert_array_equal(first, np.arange(500))
    np.testing.assert_array_equal(repeated[first[owner]], repeated)
