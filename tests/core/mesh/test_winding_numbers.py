"""Winding numbers by counting faces above, against the sum of solid angles."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from topokit.core.mesh.winding_numbers import winding_numbers
from topokit.testing import genus_mesh, icosphere, torus_mesh

Floats = NDArray[np.float64]


def of_one_surface(vertices: Floats, faces: NDArray[np.int64], points: Floats) -> Floats:
    return winding_numbers(
        vertices, faces, np.zeros(len(faces), dtype=np.int64), points, np.zeros(len(points), dtype=np.int64)
    )


def solid_angles(triangles: Floats, points: Floats) -> Floats:
    """The generalized winding number: van Oosterom and Strackee 1983, DOI 10.1109/TBME.1983.325207."""
    a, b, c = (triangles[:, None, i] - points[None] for i in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
    volume = (a * np.cross(b, c)).sum(-1)
    spread = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return np.asarray(np.arctan2(volume, spread).sum(0) / (2 * np.pi))


def distances(triangles: Floats, points: Floats) -> Floats:
    shape = (len(points), len(triangles), 3)
    pairs = np.broadcast_to(points[:, None], shape).reshape(-1, 3)
    closest = trimesh.triangles.closest_point(np.tile(triangles, (len(points), 1, 1)), pairs)
    found = np.linalg.norm(closest - pairs, axis=1).reshape(shape[:2])
    return np.asarray(np.fmin.reduce(found, axis=1))  # old trimesh finds NaN for triangles without area


def test_inside_outside_and_turned_over() -> None:
    vertices, faces = icosphere(3)
    points = np.array([[0.0, 0, 0], [0.3, 0.2, 0.1], [2.0, 0, 0], [0, 0, -5.0], [0, 0, 5.0]])
    assert of_one_surface(vertices, faces, points).tolist() == [1, 1, 0, 0, 0]
    assert of_one_surface(vertices, faces[:, ::-1], points).tolist() == [-1, -1, 0, 0, 0]


@pytest.mark.parametrize("rounded", [False, True], ids=["general", "lattice"])
@pytest.mark.parametrize("mesh", [icosphere(2), torus_mesh(12, 8), genus_mesh(2, 8)], ids=["ball", "torus", "bar"])
def test_they_equal_the_sum_of_solid_angles(mesh: tuple[Floats, NDArray[np.int64]], rounded: bool) -> None:
    """On a lattice most lines pass through edges and vertices, and many faces are seen edge-on or fold over."""
    vertices, faces = mesh
    points = np.random.default_rng(0).uniform(vertices.min(0) - 0.1, vertices.max(0) + 0.1, (600, 3))
    if rounded:
        vertices, points = np.round(4 * vertices) / 4, np.round(4 * points) / 4
    expected = solid_angles(vertices[faces], points)
    found = of_one_surface(vertices, faces, points)
    is_off_surface = distances(vertices[faces], points) > 1e-12
    assert is_off_surface.mean() > 0.5
    np.testing.assert_allclose(found[is_off_surface], expected[is_off_surface], atol=1e-9)
    assert (np.abs(found[is_off_surface]) > 0.5).sum() > 100


def test_points_of_the_surface_are_not_inside() -> None:
    vertices, faces = icosphere(2)
    assert (np.abs(of_one_surface(vertices, faces, vertices)) <= 0.5).all()


def test_groups_do_not_see_each_other() -> None:
    vertices, faces = icosphere(1)
    both = np.concatenate((vertices, vertices + 5.0))
    groups = np.repeat([0, 1], len(faces))
    points = np.array([[0.0, 0, 0], [0.0, 0, 0], [5.0, 5, 5], [5.0, 5, 5]])
    found = winding_numbers(
        both, np.concatenate((faces, faces + len(vertices))), groups, points, np.array([0, 1, 0, 1])
    )
    assert found.tolist() == [1, 0, 0, 1]
