"""Signs along the surface: sheets are followed, gaps are not crossed, creases turn, parts enclose positive volumes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from topokit.core.cloud import propagation
from topokit.core.cloud.axes import surface_axes
from topokit.core.cloud.dense import dense_cloud
from topokit.core.cloud.neighborhoods import local_geometry
from topokit.core.cloud.patch_graph import relative_signs
from topokit.core.cloud.planes import plane_axes
from topokit.core.cloud.propagation import propagate_signs
from topokit.testing import sphere_samples, torus_samples

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def plate(n_points: int, thickness: float) -> tuple[Floats, Floats]:
    """A flat closed box: two faces and a rim of semicircles would be smoother, but sharp edges are the harder case."""
    random = np.random.default_rng(0)
    sides = np.array([1.0, 1.0, thickness])
    areas = np.array([thickness, thickness, 1.0])
    axis = random.choice(3, n_points, p=areas / areas.sum())
    points = random.random((n_points, 3)) * sides
    upper = random.random(n_points) < 0.5
    rows = np.arange(n_points)
    points[rows, axis] = np.where(upper, sides[axis], 0.0)
    normals = np.zeros((n_points, 3))
    normals[rows, axis] = np.where(upper, 1.0, -1.0)
    return points - sides / 2, normals


def share_right(points: Floats, normals: Floats) -> float:
    surface = surface_axes(points)
    found = propagate_signs(points, surface.axes, surface.areas, surface.neighbors, by_vote=True)
    return float(((found.normals * normals).sum(1) > 0).mean())


def test_smooth_surfaces_are_oriented_outward() -> None:
    for known in (sphere_samples(5000), torus_samples(8000)):
        assert share_right(known.points.numpy(), known.normals.numpy()) == 1.0


def test_a_thin_plate_is_oriented_across_its_edges() -> None:
    points, normals = plate(60_000, 0.03)  # the faces are five spacings apart
    assert share_right(points, normals) > 0.99


def test_right_angles_between_exact_faces_are_crossed() -> None:
    points, normals = plate(40_000, 0.5)
    surface = surface_axes(points)
    axes = normals * np.random.default_rng(1).choice([-1.0, 1.0], len(points))[:, None]
    found = propagate_signs(points, axes, surface.areas, surface.neighbors, by_vote=True)
    assert ((found.normals * normals).sum(1) > 0).all()
    spread = [np.ptp(normals[found.patches == patch], axis=0).max() for patch in np.unique(found.patches)]
    assert 6 <= len(spread) < 12
    assert max(spread) == 0


def test_rough_points_are_cut_into_a_bounded_number_of_patches(monkeypatch: pytest.MonkeyPatch) -> None:
    known = sphere_samples(5000)
    random = np.random.default_rng(0)
    points = known.points.numpy() * (1 + 0.005 * random.normal(size=(5000, 1)))
    surface = surface_axes(points)
    counts: list[int] = []

    def counted(count: int, first: Integers, second: Integers, votes: Floats) -> Floats:
        counts.append(count)
        return relative_signs(count, first, second, votes)

    monkeypatch.setattr(propagation, "relative_signs", counted)
    for most in (propagation._MOST_PATCHES, 50):
        monkeypatch.setattr(propagation, "_MOST_PATCHES", most)
        found = propagate_signs(points, surface.axes, surface.areas, surface.neighbors, by_vote=True)
        assert ((found.normals * known.normals.numpy()).sum(1) > 0).mean() > 0.999
    assert counts[0] > 500
    assert counts[1] == 51


def test_the_number_of_patches_is_bounded_where_all_steps_weigh_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(propagation, "_MOST_PATCHES", 50)
    is_within = propagation._within_patches(np.full(1000, 0.3))
    assert np.count_nonzero(~is_within) == 50


def test_noisy_points_are_not_asked_to_vote() -> None:
    known = sphere_samples(50_000)
    spacing = (known.area / 50_000) ** 0.5
    points = known.points.numpy() * (1 + 0.3 * spacing * np.random.default_rng(0).normal(size=(50_000, 1)))
    surface, wrong = surface_axes(points), {}
    assert not surface.planes.show_creases
    for by_vote in (False, True):
        found = propagate_signs(points, surface.axes, surface.areas, surface.neighbors, by_vote=by_vote)
        wrong[by_vote] = int(((found.normals * known.normals.numpy()).sum(1) < 0).sum())
    assert wrong[False] < 0.001 * len(points)
    assert wrong[False] < wrong[True]
    chosen = dense_cloud(points, surface).propagation.normals
    assert ((chosen * known.normals.numpy()).sum(1) < 0).sum() == wrong[False]


def test_parts_are_told_apart_and_each_turned_outward() -> None:
    sphere, ring = sphere_samples(3000), torus_samples(5000)
    points = np.concatenate((sphere.points.numpy() - [5.0, 0, 0], ring.points.numpy()))
    normals = np.concatenate((sphere.normals.numpy(), ring.normals.numpy()))
    surface = surface_axes(points)
    found = propagate_signs(points, surface.axes, surface.areas, surface.neighbors, by_vote=True)
    assert len(np.unique(found.parts[:3000])) == len(np.unique(found.parts[3000:])) == 1
    assert found.parts[0] != found.parts[-1]
    assert ((found.normals * normals).sum(1) > 0).all()


def test_axes_areas_and_noise_of_a_sphere() -> None:
    known = sphere_samples(20_000)
    points, normals = known.points.numpy(), known.normals.numpy()
    surface = surface_axes(points)
    assert np.abs((surface.axes * normals).sum(1)).min() > 0.98
    assert surface.areas.sum() == pytest.approx(known.area, rel=0.15)
    assert surface.relative_thickness < 0.05
    noisy = points * (1 + 0.02 * np.random.default_rng(0).normal(size=(len(points), 1)))
    assert surface_axes(noisy).relative_thickness > 0.17
    gaps = np.linalg.norm(points[surface.neighbors] - points[:, None], axis=2)
    assert (np.diff(gaps, axis=1) >= 0).all()
    assert (gaps > 0).all()


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.05])
def test_roughness_is_in_spacings_at_every_size(noise: float) -> None:
    known = sphere_samples(6000)
    points = known.points.numpy() * (1 + noise * np.random.default_rng(0).normal(size=(6000, 1)))
    local, surface = local_geometry(points), surface_axes(points)
    assert surface.roughness == pytest.approx(local.roughness, rel=1e-9)
    assert surface.spacing == pytest.approx(local.spacing, rel=1e-9)


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
