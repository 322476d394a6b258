"""Given normals: kept, reversed, or found anew where they contradict each other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from sample_arrays import Cloud, Floats, sphere, torus

from topokit.core.cloud.given_normals import Signs, consistent_signs
from topokit.core.cloud.normals.patches import patches_of, unit
from topokit.core.cloud.settings import CloudSettings, GivenSettings, SamplingSettings
from topokit.core.cloud.witness import global_witness

SETTINGS = CloudSettings()
LARGE = CloudSettings(sampling=SamplingSettings(whole=2500, samples=1500))


def signs_of(points: Floats, normals: Floats, settings: CloudSettings = SETTINGS) -> Signs | None:
    surface = patches_of(points, SETTINGS.patches)
    return consistent_signs(points, normals, surface.areas(normals), surface.spacing, settings)


@pytest.mark.parametrize("make", [sphere, torus])
def test_consistent_normals_fall_along_their_field(make: Callable[[], Cloud]) -> None:
    points, normals = make()
    tilted = unit(normals + 0.2 * np.random.default_rng(0).normal(size=normals.shape))
    for given, source in ((normals, "given"), (-normals, "reversed"), (tilted, "given")):
        found = signs_of(points, given)
        assert found is not None
        assert (found.source, found.coverage) == (source, None)
        assert found.confirmed is not None
        assert found.confirmed > 0.97
        np.testing.assert_array_equal(found.apply(given), given if source == "given" else -given)


@pytest.mark.parametrize("make", [sphere, torus])
def test_normals_of_two_signs_are_not_consistent(make: Callable[[], Cloud]) -> None:
    points, normals = make()
    half = np.where(points[:, :1] > 0.3, -1.0, 1.0)
    few = np.where(np.random.default_rng(0).random((len(points), 1)) < 0.15, -1.0, 1.0)
    assert signs_of(points, normals * half) is None
    assert signs_of(points, normals * few) is None
    lenient = CloudSettings(given=GivenSettings(consistent=0.5, largest_residual=1.0))
    assert signs_of(points, normals * few, lenient) is not None


def test_signs_that_were_found_say_nothing_about_given_normals() -> None:
    normals = np.eye(3)
    for source in ("contradictory", "axes", "none"):
        assert Signs(source, None, 1.0).apply(normals) is None  # type: ignore[arg-type]
    assert Signs("given", 1.0, None).apply(None) is None


@pytest.mark.parametrize(("settings", "n_points"), [(SETTINGS, 2000), (LARGE, 4000)], ids=["whole", "sampled"])
def test_contradictory_normals_are_found_anew(settings: CloudSettings, n_points: int) -> None:
    points, normals = torus(n_points)
    is_wrong = points[:, 0] > 0.5
    flipped = np.where(is_wrong[:, None], -normals, normals)
    found = global_witness(torch.from_numpy(points), torch.from_numpy(flipped), settings=settings)
    assert (found.euler, found.signs.source) == (0, "contradictory")
    assert found.signs.confirmed == pytest.approx(1 - is_wrong.mean(), abs=0.03)
    assert ((found.normals * normals).sum(1) > 0).mean() > 0.99
    np.testing.assert_allclose(np.abs((found.normals * normals).sum(1)), 1)  # the given axes stay


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_few_wrong_signs_do_not_refute_the_others(sign: float) -> None:
    """Normals that their field does not confirm are compared with found ones."""
    points, normals = torus()
    is_wrong = np.random.default_rng(0).random(len(points)) < 0.01
    given = sign * np.where(is_wrong[:, None], -normals, normals)
    settings = CloudSettings(given=GivenSettings(consistent=0.999))
    assert signs_of(points, given, settings) is None
    found = global_witness(torch.from_numpy(points), torch.from_numpy(given), settings=settings)
    assert (found.euler, found.signs.source) == (0, "given" if sign > 0 else "reversed")
    assert found.signs.confirmed == pytest.approx(1 - is_wrong.mean(), abs=1e-9)
    np.testing.assert_array_equal(found.normals, sign * unit(given))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_walls_thinner_than_the_spacing_do_not_refute_given_signs(sign: float) -> None:
    """No signs can be found there, so they say neither that given ones are wrong nor that they point inward."""
    points, _ = sphere(800)
    shell, normals = np.concatenate((points, 0.97 * points)), np.concatenate((points, -points))
    assert signs_of(shell, normals) is None
    found = global_witness(torch.from_numpy(shell), torch.from_numpy(sign * normals))
    assert found.signs.source == ("given" if sign > 0 else "reversed")
    np.testing.assert_allclose(found.normals, normals, atol=1e-12)


def test_normals_without_signs_are_axes() -> None:
    points, normals = torus()
    turned = normals * np.random.default_rng(0).choice([-1.0, 1.0], (len(points), 1))
    found = global_witness(torch.from_numpy(points), torch.from_numpy(turned), oriented=False)
    assert (found.euler, found.signs.source, found.signs.confirmed) == (0, "axes", None)
    np.testing.assert_allclose(found.normals, normals, atol=1e-12)
