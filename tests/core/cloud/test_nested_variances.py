"""Variances of neighborhoods inside of each other are those of each by itself."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from topokit.core.cloud.nested_variances import nested_variances

SIZES = (4, 7, 50)


@pytest.mark.parametrize("offset", [0.0, 1e4])
def test_each_is_that_of_its_points(offset: float) -> None:
    points = np.random.default_rng(0).normal(size=(200, 3)) * (1.0, 0.3, 0.01) + offset
    nearest = cKDTree(points).query(points[:20], SIZES[-1])[1]
    expected = [[np.linalg.eigvalsh(np.cov(points[row[:size]].T, bias=True)) for row in nearest] for size in SIZES]
    np.testing.assert_allclose(nested_variances(points, nearest, SIZES), expected, rtol=1e-5)


def test_it_is_never_negative_for_points_in_a_plane() -> None:
    points = np.random.default_rng(0).normal(size=(200, 3)) * (1.0, 1.0, 0.0)
    nearest = cKDTree(points).query(points, SIZES[-1])[1]
    variance = nested_variances(points, nearest, SIZES)
    assert (variance >= 0).all()
    assert variance[..., 0].max() < 1e-15
