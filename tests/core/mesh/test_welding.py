"""Equal and nearly equal vertices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from topokit.core.mesh import welding
from topokit.core.mesh.welding import equal_vertices, may_have_near, near_vertices


def first_of_equal_rows(points: np.ndarray) -> np.ndarray:
    _, first, group = np.unique(points + 0.0, axis=0, return_index=True, return_inverse=True)
    return first[group.ravel()]


@pytest.mark.parametrize("n_points", [1, 7, 5000])
def test_equal_vertices_are_found(n_points: int) -> None:
    points = np.random.default_rng(0).integers(-4, 5, (n_points, 3)) / 7.0
    assert (equal_vertices(points) == first_of_equal_rows(points)).all()


def test_minus_zero_is_zero_and_one_digit_is_a_difference() -> None:
    points = np.array([[0.0, 1, 2], [-0.0, 1, 2], [np.nextafter(0, 1), 1, 2], [0, 1, 2]])
    assert equal_vertices(points).tolist() == [0, 0, 2, 0]


def test_a_hash_that_tells_nothing_apart_costs_time_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(welding, "row_hashes", lambda rows, start: (start + rows[:, 0] % 3).astype(np.uint64))
    points = np.random.default_rng(0).integers(-4, 5, (3000, 3)) / 7.0
    assert (equal_vertices(points) == first_of_equal_rows(points)).all()


@pytest.mark.parametrize("seed", range(3))
def test_near_vertices_are_those_of_a_tree_over_all_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    apart = 1e6 + rng.random((1500, 3))
    points = np.concatenate((apart, apart[:200] + 1e-9 * rng.uniform(-1, 1, (200, 3))))
    radius = 1.5e-9
    pairs = cKDTree(points).query_pairs(radius, output_type="ndarray")
    candidates = may_have_near(points, radius)
    assert candidates[pairs].all()
    assert candidates.sum() < 600
    first = near_vertices(points, radius, candidates)
    assert (first[pairs[:, 0]] == first[pairs[:, 1]]).all()
    assert set(np.flatnonzero(first != np.arange(len(points)))) == set(pairs[:, 1])


def test_chains_of_near_vertices_become_one() -> None:
    points = np.array([[0.0, 0, 0], [5, 5, 5], [0.9, 0, 0], [1.8, 0, 0], [7, 0, 0]])
    assert near_vertices(points, 1.0, may_have_near(points, 1.0)).tolist() == [0, 1, 0, 0, 4]
