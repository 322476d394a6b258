"""Planes near creases are those of one face, with its sign; where there is no crease, nothing changes."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from topokit.core.cloud.normals.creases import Faces, find_faces
from topokit.core.cloud.normals.patches import Patches, patches_of
from topokit.core.cloud.normals.propagation import propagate_signs
from topokit.core.cloud.reconstruction import Cloud, reconstruct
from topokit.core.cloud.settings import CloudSettings
from topokit.testing import sphere_samples

Floats = NDArray[np.float64]
SETTINGS = CloudSettings()
WEDGE = np.array([[0, 0, 0], [0, 2, 0], [1, 0, 0.25], [1, 2, 0.25], [1, 0, -0.25], [1, 2, -0.25]])  # edge of 28°


def on_faces(mesh: trimesh.Trimesh, count: int) -> tuple[Floats, Floats]:
    """Independent points on a mesh, and the normals of its faces there."""
    points, face = trimesh.sample.sample_surface(mesh, count, seed=0)
    return np.asarray(points), mesh.face_normals[face]


def share_off(axes: Floats, normals: Floats, degrees: float = 15.0) -> float:
    """Share of axes farther than an angle from the normals, whatever their signs."""
    return float((np.abs((axes * normals).sum(1)) < np.cos(np.radians(degrees))).mean())


def faces_of(points: Floats) -> tuple[Patches, Faces]:
    surface = patches_of(points, SETTINGS.patches)
    return surface, find_faces(surface, SETTINGS.creases)


@pytest.mark.parametrize("mesh", [trimesh.creation.box((2, 1, 0.3)), trimesh.convex.convex_hull(WEDGE)])
def test_axes_near_creases_are_those_of_a_face(mesh: trimesh.Trimesh) -> None:
    points, normals = on_faces(mesh, 40_000)
    surface, faces = faces_of(points)
    assert faces.show
    axes = surface.planes.axes
    before, after = share_off(axes, normals), share_off(faces.sharpened(axes), normals)
    assert before > 0.02
    assert after < before / 10


def test_faces_carry_the_signs_found_farther_from_the_crease() -> None:
    points, normals = on_faces(trimesh.creation.box((2, 1, 0.3)), 40_000)
    surface, faces = faces_of(points)
    axes = faces.sharpened(surface.planes.axes)
    found = propagate_signs(
        points, axes, surface.areas(), surface.neighbors, by_vote=faces.show, settings=SETTINGS.signs
    )
    assert ((found.normals * normals).sum(1) > 0.99).mean() > 0.999


def test_samples_are_oriented_with_the_normals_of_faces() -> None:
    points, normals = on_faces(trimesh.creation.box((2, 1, 0.6)), 3000)
    surface, _ = faces_of(points)
    found = reconstruct(Cloud(points, None, oriented=True), surface, SETTINGS).found
    assert found is not None
    assert share_off(surface.planes.axes, normals) > 0.1
    assert all(share_off(trial.normals, normals) < 0.03 for trial in found.trials)
    assert ((found.normals * normals).sum(1) > 0).all()


def test_smooth_samples_have_no_creases() -> None:
    sphere = sphere_samples(20_000)
    points, normals = sphere.points.numpy(), sphere.normals.numpy()
    _, faces = faces_of(points)
    assert faces.show
    assert faces.is_replaced.mean() < 0.04
    assert share_off(faces.sharpened(normals), normals, degrees=5.0) < 0.001


def test_noise_is_no_crease() -> None:
    sphere = sphere_samples(20_000)
    noise = 0.005 * np.random.default_rng(0).normal(size=(20_000, 3))  # 0.2 sample spacings
    surface, faces = faces_of(sphere.points.numpy() + noise)
    assert not faces.show
    assert not faces.is_replaced.any()
    axes = surface.planes.axes
    np.testing.assert_array_equal(faces.sharpened(axes), axes)


def test_a_point_without_a_better_plane_stands_for_itself() -> None:
    points, _ = on_faces(trimesh.creation.box((1, 1, 1)), 5000)
    _, faces = faces_of(points)
    own = np.arange(len(points))
    assert faces.is_replaced.any()
    assert (faces.owner[~faces.is_replaced] == own[~faces.is_replaced]).all()
    normals = np.random.default_rng(0).normal(size=(5000, 3))
    assert (faces.sharpened(normals)[~faces.is_replaced] == normals[~faces.is_replaced]).all()
