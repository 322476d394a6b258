"""Noise is measured, averaged away where it exceeds the spacing, and left alone where it does not."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from topokit.core.cloud.noise import averaged, noise_of
from topokit.core.cloud.normals.patches import Patches, patches_of
from topokit.core.cloud.settings import CloudSettings, SamplingSettings
from topokit.core.cloud.witness import global_witness
from topokit.testing import sphere_samples, torus_samples

Floats = NDArray[np.float64]
SETTINGS = CloudSettings()
SAMPLES = {"sphere": sphere_samples, "torus": torus_samples}
MORE_NOISE = [(10_000, 0.02), (10_000, 0.04), (20_000, 0.01), (20_000, 0.02), (20_000, 0.04)]
EULER = {"sphere": 2, "torus": 0}


def noisy(shape: str, n_points: int, sigma: float) -> Floats:
    """Even samples of a shape of radius 1, with independent normal errors in all three coordinates."""
    return SAMPLES[shape](n_points).points.numpy() + sigma * np.random.default_rng(0).normal(size=(n_points, 3))


def around(points: Floats) -> Patches:
    return patches_of(points, SETTINGS.patches)


def level(points: Floats) -> float:
    found = noise_of(around(points), SETTINGS)
    assert found is not None
    return found.level


def distance(shape: str, points: Floats) -> Floats:
    """Signed distance of points from the sphere or torus."""
    if shape == "sphere":
        return np.linalg.norm(points, axis=1) - 1
    return np.hypot(np.hypot(*points[:, :2].T) - 1, points[:, 2]) - 0.4


@pytest.mark.parametrize("shape", SAMPLES)
@pytest.mark.parametrize(
    ("n_points", "sigma"),
    [
        (10_000, 0.01),
        (6_000, 0.08),
        *(pytest.param(n_points, sigma, marks=pytest.mark.long) for n_points, sigma in MORE_NOISE),
    ],
)
def test_the_noise_is_measured(shape: str, n_points: int, sigma: float) -> None:
    """From a quarter of the spacing to twice as much."""
    assert level(noisy(shape, n_points, sigma)) == pytest.approx(sigma, rel=0.16)


def test_the_noise_has_the_unit_of_the_points() -> None:
    points = noisy("sphere", 1500, 0.08)
    assert level(1000 * points + 7) == pytest.approx(1000 * level(points), rel=1e-6)


def test_few_points_have_neighborhoods_of_fewer_sizes() -> None:
    assert level(noisy("sphere", 400, 0.1)) == pytest.approx(0.1, rel=0.5)


def test_points_that_fill_space_are_left_alone() -> None:
    blob = np.random.default_rng(0).normal(size=(2000, 3))
    assert averaged(around(blob), SETTINGS) is None


def test_a_surface_that_bends_has_no_noise() -> None:
    assert noise_of(around(noisy("sphere", 3000, 0.0)), SETTINGS) is None


@pytest.mark.parametrize("n_points", [3000, 40_000])
def test_clean_clouds_are_left_alone(n_points: int) -> None:
    assert averaged(around(noisy("torus", n_points, 0.0)), SETTINGS) is None
    assert averaged(around(noisy("sphere", n_points, 0.1 * (4 * np.pi / n_points) ** 0.5)), SETTINGS) is None


def test_noise_is_averaged_if_samples_apart_by_it_are_fewer_or_if_not_all_points_are_used() -> None:
    little, large = noisy("sphere", 5000, 0.025), noisy("sphere", 5000, 0.05)  # half a spacing and one
    fewer = CloudSettings(sampling=SamplingSettings(whole=4000, samples=3000))
    assert averaged(around(little), SETTINGS) is None
    assert averaged(around(little), fewer) is not None
    assert averaged(around(large), SETTINGS) is not None


def test_two_sheets_close_together_are_no_noise() -> None:
    points = sphere_samples(5000).points.numpy()
    two = np.concatenate((points, 0.95 * sphere_samples(4500).points.numpy()))  # a spacing apart
    assert around(two).roughness > SETTINGS.signs.roughness
    assert averaged(around(two), SETTINGS) is None


@pytest.mark.parametrize(
    ("shape", "sigma"),
    [
        ("torus", 0.02),
        *(
            pytest.param(*case, marks=pytest.mark.long)
            for case in (("torus", 0.04), ("sphere", 0.02), ("sphere", 0.04))
        ),
    ],
)
def test_fewer_points_lie_nearer_to_the_surface(shape: str, sigma: float) -> None:
    settings = CloudSettings(sampling=SamplingSettings(whole=10_000, samples=5000))
    points = noisy(shape, 20_000, sigma)
    found = averaged(around(points), settings)
    assert found is not None
    moved, kept, owner, blur = found
    assert blur == pytest.approx(2 * sigma, rel=0.2)
    assert moved.shape == (len(kept), 3)
    assert 1000 < len(kept) <= 10_000
    assert (np.diff(kept) > 0).all()
    np.testing.assert_array_equal(owner[kept], np.arange(len(kept)))
    way = distance(shape, moved)
    assert np.std(way) < 0.6 * sigma
    assert abs(np.mean(way)) < 0.1 * sigma
    spacing = (SAMPLES[shape](4).area / len(kept)) ** 0.5
    assert spacing > 0.9 * sigma  # details below that are lost


@pytest.mark.parametrize("shape", [pytest.param("sphere", marks=pytest.mark.long), "torus"])
def test_a_cloud_slightly_larger_than_one_that_is_used_whole_has_the_same_integer(shape: str) -> None:
    settings = CloudSettings(sampling=SamplingSettings(whole=2500, samples=1650))
    for n_points, preparation in ((2000, "whole"), (3000, "averaged")):
        witness = global_witness(torch.from_numpy(noisy(shape, n_points, 0.035)), settings=settings)
        assert (witness.euler, witness.preparation) == (EULER[shape], preparation)
        assert witness.agreement == 1


@pytest.mark.parametrize("shape", [pytest.param("sphere", marks=pytest.mark.long), "torus"])
def test_noise_of_a_spacing_is_averaged(shape: str) -> None:
    settings = CloudSettings(sampling=SamplingSettings(whole=2500, samples=1650))
    witness = global_witness(torch.from_numpy(noisy(shape, 3000, 0.07)), settings=settings)
    assert (witness.euler, witness.preparation) == (EULER[shape], "averaged")
    assert witness.agreement > 0.9


@pytest.mark.long
@pytest.mark.parametrize(("sigma", "preparation"), [(0.005, "sampled"), (0.02, "averaged")])
def test_forty_thousand_noisy_points(sigma: float, preparation: str) -> None:
    known = torus_samples(40_000)
    witness = global_witness(torch.from_numpy(noisy("torus", 40_000, sigma)))
    assert (witness.euler, witness.preparation, witness.agreement) == (0, preparation, 1)
    assert ((torch.from_numpy(witness.normals) * known.normals).sum(1) > 0).double().mean() > 0.95
    assert witness.normals.shape == (40_000, 3)
    assert witness.surface is not None
    assert witness.surface.points.max() < 40_000


def test_noise_of_two_spacings_leaves_few_samples_and_their_signs_are_found() -> None:
    """Around so few samples a coarse grid must not have many cells."""
    points, settings = noisy("sphere", 4000, 0.1), CloudSettings(sampling=SamplingSettings(whole=3000, samples=2000))
    witness = global_witness(torch.from_numpy(points), settings=settings)
    assert (witness.euler, witness.preparation, witness.agreement) == (2, "averaged", 1)
    assert witness.n_used < 1000
    assert ((witness.normals * points).sum(1) > 0).mean() > 0.95


@pytest.mark.parametrize(("shape", "sigma"), [pytest.param("sphere", 0.1, marks=pytest.mark.long), ("torus", 0.08)])
def test_noise_of_four_spacings_is_seen_in_neighborhoods_of_thousands(shape: str, sigma: float) -> None:
    witness = global_witness(torch.from_numpy(noisy(shape, 40_000, sigma)))
    assert (witness.euler, witness.preparation) == (EULER[shape], "averaged")
    assert witness.agreement > 0.9
    assert witness.n_used < 2000
