"""Downsampling: budgets are kept, features get samples, noise does not."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from topokit.core.cloud.sampling.cube_hierarchy import curve_order
from topokit.core.cloud.sampling.downsampling import Criterion, downsample, thin_along_curve
from topokit.testing import sphere_samples, torus_samples

Floats = NDArray[np.float64]
RANDOM_SEED = 0


def plane_with_bump(n_points: int = 40_000, height: float = 0.05) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """A square with a small round bump: points, unit normals, and which points are on the bump."""
    at = np.random.default_rng(RANDOM_SEED).uniform(-1, 1, (n_points, 2))
    width = 0.06
    bump = height * np.exp(-(at**2).sum(1) / (2 * width**2))
    normals = np.concatenate((at / width**2 * bump[:, None], np.ones((n_points, 1))), axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.concatenate((at, bump[:, None]), axis=1), normals, (at**2).sum(1) < (3 * width) ** 2


def plate(n_points: int = 40_000, thickness: float = 0.02) -> tuple[Floats, Floats]:
    """The two faces of a thin square plate."""
    random = np.random.default_rng(RANDOM_SEED)
    top = random.random(n_points) < 0.5
    height = np.where(top, thickness, 0.0)
    points = np.concatenate((random.uniform(-1, 1, (n_points, 2)), height[:, None]), axis=1)
    return points, np.outer(np.where(top, 1.0, -1.0), [0.0, 0, 1])


@pytest.mark.parametrize("by", get_args(Criterion))
@pytest.mark.parametrize("n_samples", [500, 3000])
def test_the_budget_is_used_and_not_exceeded(by: Criterion, n_samples: int) -> None:
    points, normals, _ = plane_with_bump()
    kept, owner = downsample(points, n_samples, by, normals)
    assert 0.85 * n_samples <= len(kept) <= n_samples
    assert (np.diff(kept) > 0).all()
    assert owner.min() == 0
    assert owner.max() == len(kept) - 1
    np.testing.assert_array_equal(owner[kept], np.arange(len(kept)))
    again = downsample(points.copy(), n_samples, by, normals)
    np.testing.assert_array_equal(kept, again[0])


@pytest.mark.parametrize("by", get_args(Criterion))
def test_neither_rounding_nor_the_order_of_the_points_decides(by: Criterion) -> None:
    """Most cubes hold two or three points here; the two points of a cube are an exact tie."""
    samples, random = torus_samples(3000), np.random.default_rng(RANDOM_SEED)
    assert samples.normals is not None
    points, normals = samples.points.numpy(), samples.normals.numpy()
    kept, _ = downsample(points, 1200, by, normals)
    moved, _ = downsample(points + 1e-12 * random.standard_normal(points.shape), 1200, by, normals)
    order = random.permutation(len(points))
    permuted, _ = downsample(points[order], 1200, by, normals[order])
    np.testing.assert_array_equal(moved, kept)
    np.testing.assert_array_equal(np.sort(order[permuted]), kept)


@pytest.mark.parametrize("by", ["feature-size", "curvature"])
def test_a_bump_gets_more_than_its_share(by: Criterion) -> None:
    points, normals, on_bump = plane_with_bump()
    kept, _ = downsample(points, 2000, by, normals)
    assert on_bump[kept].mean() > 4 * on_bump.mean()
    even, _ = downsample(points, 2000, "even")
    assert on_bump[even].mean() == pytest.approx(on_bump.mean(), abs=0.02)


def test_thin_walls_get_samples_and_with_normals_both_sides_do() -> None:
    points, normals = plate()
    box = np.random.default_rng(1).uniform(2, 4, (40_000, 2))
    both = np.concatenate((points, np.concatenate((box, np.zeros((40_000, 1))), axis=1)))
    kept, _ = downsample(both, 4000, "feature-size")
    assert (kept < len(points)).mean() > 0.75  # the plate, not the single sheet of equal area beside it
    few, owner = downsample(points, 400, "feature-size", normals)
    assert 0.4 < (normals[few, 2] > 0).mean() < 0.6
    np.testing.assert_array_equal(normals[few[owner], 2], normals[:, 2])  # no sample stands for the other side


def test_noise_does_not_attract_samples() -> None:
    points, _, on_bump = plane_with_bump(height=0.3)
    noisy = points + np.random.default_rng(2).normal(0, 0.004, points.shape)
    blind, _ = downsample(noisy, 4000, "feature-size")
    kept, _ = downsample(noisy, 4000, "feature-size", noise=0.004)
    assert on_bump[kept].mean() > 2 * on_bump[blind].mean()
    assert on_bump[kept].mean() > 2 * on_bump.mean()


def test_even_samples_are_even_whatever_the_density() -> None:
    points = sphere_samples(60_000).points.numpy()
    crowded = np.concatenate((points, points[points[:, 2] > 0.5], points[points[:, 2] > 0.5] * 1.0001))
    kept, _ = downsample(crowded, 5000, "even")
    assert (crowded[kept, 2] > 0.5).mean() == pytest.approx(0.25, abs=0.03)


def test_few_points_are_kept_whole() -> None:
    points = sphere_samples(100).points.numpy()
    for by in get_args(Criterion):
        np.testing.assert_array_equal(downsample(points, 100, by, points)[0], np.arange(100))
    np.testing.assert_array_equal(thin_along_curve(points, 100), np.arange(100))


def test_thinning_along_the_curve_keeps_proportions() -> None:
    points = sphere_samples(30_000).points.numpy()
    crowded = np.concatenate((points, points[points[:, 2] > 0] + 1e-4))
    kept = thin_along_curve(crowded, 5000)
    assert len(kept) <= 5000
    assert (crowded[kept, 2] > 0).mean() == pytest.approx(2 / 3, abs=0.02)
    order, key = curve_order(points)
    assert (np.diff(key.astype(np.float64)) >= 0).all()
    jump = np.linalg.norm(np.diff(points[order], axis=0), axis=1)
    assert np.median(jump) < 0.05  # neighbors along the curve are neighbors in space
