"""Planes near creases are those of one face, with its sign; where there is no crease, nothing changes."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from topokit.core.cloud.axes import surface_axes
from topokit.core.cloud.dense import dense_cloud
from topokit.core.cloud.neighborhoods import local_geometry
from topokit.core.cloud.orientation import orient_samples
from topokit.testing import sphere_samples

Floats = NDArray[np.float64]
WEDGE = np.array([[0, 0, 0], [0, 2, 0], [1, 0, 0.25], [1, 2, 0.25], [1, 0, -0.25], [1, 2, -0.25]])  # edge of 28°


def on_faces(mesh: trimesh.Trimesh, count: int) -> tuple[Floats, Floats]:
    """Independent points on a mesh, and the normals of its faces there."""
    points, face = trimesh.sample.sample_surface(mesh, count, seed=0)
    return np.asarray(points), mesh.face_normals[face]


def share_off(axes: Floats, normals: Floats, degrees: float = 15.0) -> float:
    """Share of axes farther than an angle from the normals, whatever their signs."""
    return float((np.abs((axes * normals).sum(1)) < np.cos(np.radians(degrees))).mean())


@pytest.mark.parametrize("mesh", [trimesh.creation.box((2, 1, 0.3)), trimesh.convex.convex_hull(WEDGE)])
def test_axes_near_creases_are_those_of_a_face(mesh: trimesh.Trimesh) -> None:
    points, normals = on_faces(mesh, 40_000)
    surface = surface_axes(points)
    assert surface.faces is not None
    before, after = share_off(surface.axes, normals), share_off(surface.faces.sharpened(surface.axes), normals)
    assert before > 0.02
    assert after < before / 10


def test_faces_carry_the_signs_found_farther_from_the_crease() -> None:
    points, normals = on_faces(trimesh.creation.box((2, 1, 0.3)), 40_000)
    found = dense_cloud(points, surface_axes(points)).propagation
    assert ((found.normals * normals).sum(1) > 0.99).mean() > 0.999


def test_samples_are_oriented_with_the_normals_of_faces() -> None:
    points, normals = on_faces(trimesh.creation.box((2, 1, 0.6)), 3000)
    local = local_geometry(points - points.mean(0))
    found = orient_samples(points - points.mean(0), local)
    assert share_off(local.normals, normals) > 0.1
    assert all(share_off(candidate, normals) < 0.03 for candidate, _ in found.trials)
    assert ((found.normals * normals).sum(1) > 0).all()


def test_smooth_samples_have_no_creases() -> None:
    sphere = sphere_samples(20_000)
    points, normals = sphere.points.numpy(), sphere.normals.numpy()
    faces = surface_axes(points).faces
    assert faces is not None
    assert faces.is_replaced.mean() < 0.01
    assert share_off(faces.sharpened(normals), normals, degrees=5.0) < 0.001


def test_noise_is_no_crease() -> None:
    sphere = sphere_samples(20_000)
    noise = 0.005 * np.random.default_rng(0).normal(size=(20_000, 3))  # 0.2 sample spacings
    assert surface_axes(sphere.points.numpy() + noise).faces is None


def test_a_point_without_a_better_plane_stands_for_itself() -> None:
    points, _ = on_faces(trimesh.creation.box((1, 1, 1)), 5000)
    faces = surface_axes(points).faces
    assert faces is not None
    own = np.arange(len(points))
    assert (faces.owner[~faces.is_replaced] == own[~faces.is_replaced]).all()
    normals = np.random.default_rng(0).normal(size=(5000, 3))
    assert (faces.sharpened(normals)[~faces.is_replaced] == normals[~faces.is_replaced]).all()
