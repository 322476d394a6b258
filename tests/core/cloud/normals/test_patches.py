"""Planes, areas, spacings and close sheets: against closed forms and naive twins."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from topokit.core.cloud.normals.patches import (
    flattened,
    neighborhoods_of,
    opposite_neighbors,
    patches_of,
    plane_axes,
    refitted,
    turned_towards,
    unit,
)
from topokit.core.cloud.settings import PatchSettings
from topokit.errors import InputError
from topokit.testing import sphere_samples

Floats = NDArray[np.float64]
SETTINGS = PatchSettings()


def nearest(points: Floats, count: int) -> NDArray[np.int64]:
    """The nearest points, with the point itself, one by one."""
    return np.array([np.argsort(np.linalg.norm(points - one, axis=1), kind="stable")[:count] for one in points])


def test_axes_in_closed_form_are_those_of_decompositions() -> None:
    draws = np.random.default_rng(0)
    thin = draws.normal(size=(200, 11, 3)) * np.array([1.0, 0.5, 1e-3])
    ball, line = draws.normal(size=(200, 11, 3)), draws.normal(size=(20, 11, 1)) * np.array([1.0, 2.0, 3.0])
    for patches in (thin, 1e-9 * thin, 1e9 * thin, ball):
        axes, thickness = plane_axes(patches + patches[:1])
        centered = patches + patches[:1] - (patches + patches[:1]).mean(1, keepdims=True)
        values, vectors = np.linalg.eigh(np.einsum("nka,nkb->nab", centered, centered))
        assert np.allclose(np.abs((axes * vectors[:, :, 0]).sum(1)), 1)
        assert np.allclose(thickness, np.sqrt(values[:, 0] / 11))
    axes, thickness = plane_axes(line)
    assert np.allclose(axes @ np.array([1.0, 2.0, 3.0]), 0)
    assert np.allclose(thickness, 0)
    axes, thickness = plane_axes(np.ones((3, 11, 3)))
    assert np.allclose(np.linalg.norm(axes, axis=1), 1)
    assert (thickness == 0).all()


def test_axes_and_areas_of_a_sphere() -> None:
    known = sphere_samples(20_000)
    points, normals = known.points.numpy(), known.normals.numpy()
    surface = patches_of(points, SETTINGS)
    assert np.abs((surface.planes.axes * normals).sum(1)).min() > 0.98
    assert surface.areas().sum() == pytest.approx(known.area, rel=0.15)
    assert surface.areas(normals).sum() == pytest.approx(known.area, rel=0.15)
    assert surface.spacing == pytest.approx((known.area / 20_000) ** 0.5, rel=0.05)


def test_neighbors_and_planes_are_those_found_one_by_one() -> None:
    points = np.random.default_rng(0).random((4500, 3)) * [1, 1, 0.01]  # more than one block
    surface, index = patches_of(points, SETTINGS), nearest(points, SETTINGS.plane + 1)
    np.testing.assert_array_equal(surface.points, points)
    np.testing.assert_array_equal(surface.neighbors, index[:, 1 : SETTINGS.graph + 1])
    axes, thickness = plane_axes(points[index])
    np.testing.assert_allclose(np.abs((surface.planes.axes * axes).sum(1)), 1)
    np.testing.assert_allclose(surface.planes.thickness, thickness)
    np.testing.assert_allclose(surface.planes.centers, points[index].mean(1))


@pytest.mark.parametrize("n_points", [3000, 50_000])
@pytest.mark.parametrize("noise", [0.1, 0.3, 1.0])
def test_roughness_is_the_noise_in_spacings_at_every_size(n_points: int, noise: float) -> None:
    known = sphere_samples(n_points)
    sigma = noise * (known.area / n_points) ** 0.5
    points = known.points.numpy() * (1 + sigma * np.random.default_rng(0).normal(size=(n_points, 1)))
    surface = patches_of(points, SETTINGS)
    assert surface.thickness == pytest.approx(surface.roughness * surface.spacing)
    if noise < 1:
        assert surface.roughness == pytest.approx((8 / 11) ** 0.5 * noise, rel=0.2)  # planes fit three of eleven points
    else:  # as thick as neighborhoods are wide
        assert 0.4 < surface.roughness < 1


def test_areas_count_the_own_sheet_only() -> None:
    sheet = sphere_samples(3000)
    points, normals = sheet.points.numpy(), sheet.normals.numpy()
    wall = np.concatenate((points, 0.999 * points))
    both = np.concatenate((normals, -normals))
    surface = patches_of(wall, SETTINGS)
    assert surface.areas().sum() == pytest.approx(sheet.area, rel=0.15)
    assert surface.areas(both).sum() == pytest.approx(2 * sheet.area, rel=0.15)


def test_spacings_are_those_of_discs_one_by_one() -> None:
    points = sphere_samples(500).points.numpy()
    for cloud in (points, points[:6]):
        count = len(cloud)
        local, index = neighborhoods_of(cloud, SETTINGS), nearest(cloud, min(SETTINGS.wide + 1, count))
        np.testing.assert_array_equal(local.index, index)
        rank = min(SETTINGS.graph, count - 1)
        discs = np.pi * np.linalg.norm(cloud[index[:, rank]] - cloud, axis=1) ** 2 / rank
        np.testing.assert_allclose(local.spacings, np.sqrt(discs[index[:, : SETTINGS.spacing + 1]].mean(1)))
        assert local.spacing == np.median(local.spacings)
        assert (local.spacings < local.finest).mean() <= 0.2


def test_points_of_which_most_coincide_have_no_spacing() -> None:
    with pytest.raises(InputError, match="zero"):
        patches_of(np.concatenate((np.zeros((90, 3)), np.eye(3))), SETTINGS)


def noisy_sphere() -> tuple[Floats, Floats]:
    known = sphere_samples(5000)
    points = known.points.numpy()
    return points * (1 + 0.015 * np.random.default_rng(0).normal(size=(5000, 1))), points  # 0.3 spacings


def test_planes_of_neighbors_that_agree_are_nearer_to_the_surface() -> None:
    points, normals = noisy_sphere()
    local = neighborhoods_of(points, SETTINGS)
    moved = flattened(normals, local, SETTINGS)
    before, after = (np.std(np.linalg.norm(cloud, axis=1)) for cloud in (points, moved))
    assert after < 0.5 * before
    blurred = unit(normals + 0.3 * np.random.default_rng(1).normal(size=normals.shape))
    found = refitted(blurred, local, SETTINGS)
    assert np.median((found * normals).sum(1)) > np.median((blurred * normals).sum(1))
    assert ((found * blurred).sum(1) >= 0).all()


def test_where_too_few_neighbors_agree_normals_stay() -> None:
    points, _ = noisy_sphere()
    anywhere = unit(np.random.default_rng(0).normal(size=points.shape))
    stays = (refitted(anywhere, neighborhoods_of(points, SETTINGS), SETTINGS) == anywhere).all(1)
    assert 0.5 < stays.mean() < 1


def test_opposite_neighbors_have_a_height_and_a_distance_sideways() -> None:
    up = np.array([[0.0, 0, 1]])
    points = np.array([[[0.0, 0, -0.5], [3, 0, -0.5], [0, 0.2, 0.7], [1, 0, 0]]])
    normals = np.array([[[0.0, 0, -1], [0, 0, 1], [0, 0.1, -1], [0, 1, 0]]])
    opposite, height, side = opposite_neighbors(np.zeros((1, 3)), up, points, normals, SETTINGS)
    np.testing.assert_array_equal(opposite, [[True, False, True, False]])
    np.testing.assert_allclose(height, [[-0.5, -0.5, 0.7, 0]])
    np.testing.assert_allclose(side, [[0, 9, 0.04, 1]], atol=1e-12)


def test_unit_and_turned_vectors() -> None:
    vectors = np.array([[3.0, 0, 4], [0, 0, 0], [1, 0, 0], [1e-200, 0, 0]])
    np.testing.assert_allclose(unit(vectors), [[0.6, 0, 0.8], [0, 0, 0], [1, 0, 0], [1, 0, 0]])
    axes = torch.randn(50, 3, generator=torch.Generator().manual_seed(0)).double().numpy()
    turned = turned_towards(axes, np.broadcast_to([1.0, 0, 0], axes.shape))
    np.testing.assert_array_equal(np.abs(turned), np.abs(axes))
    assert (turned[:, 0] > 0).all()
