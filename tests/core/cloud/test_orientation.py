"""Outward normals found for clouds without any, and given normals judged."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from topokit.core.cloud.delaunay_cut import delaunay_complex
from topokit.core.cloud.neighborhoods import fit_planes, local_geometry, unit
from topokit.core.cloud.orientation import check_normals, orient_samples
from topokit.core.cloud.witness import global_witness
from topokit.core.mesh.sampling import sample_triangles
from topokit.testing import sphere_samples, torus_samples

Floats = NDArray[np.float64]
Cloud = tuple[Floats, Floats]


def sphere(n_points: int = 3000) -> Cloud:
    known = sphere_samples(n_points)
    return known.points.numpy(), known.normals.numpy()


def torus(n_points: int = 3000) -> Cloud:
    known = torus_samples(n_points)
    return known.points.numpy(), known.normals.numpy()


def nested_spheres() -> Cloud:
    """A hollow ball: the normals of its inner wall point into the cavity."""
    points, normals = sphere()
    inner = sphere(2000)[0]
    return np.concatenate((points, 0.55 * inner)), np.concatenate((normals, -inner))


def linked_tori() -> Cloud:
    thinner = torus_samples(3000, minor=0.25)
    points, normals = thinner.points.numpy(), thinner.normals.numpy()
    turned = [0, 2, 1]
    other = points[:, turned] + np.array([1.0, 0, 0])
    return np.concatenate((points, other)), np.concatenate((normals, normals[:, turned]))


def box() -> Cloud:
    corners = torch.cartesian_prod(*[torch.tensor([0.0, side]).double() for side in (1.0, 0.6, 0.3)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = torch.tensor([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])
    samples, _ = sample_triangles(corners, faces, 4000)
    assert samples.normals is not None
    return samples.points.numpy(), samples.normals.numpy()


@pytest.mark.parametrize("make", [sphere, torus, nested_spheres, linked_tori, box])
def test_unoriented_clouds_are_oriented(make: Callable[[], Cloud]) -> None:
    points, normals = make()
    found = orient_samples(points, local_geometry(points))
    assert ((found.normals * normals).sum(1) > 0).mean() >= 0.99
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1)
    assert found.coverage > 0.97
    assert found.costs[found.candidate] == min(found.costs.values())


def outward(points: Floats, areas: Floats | None = None) -> Floats:
    given = None if areas is None else torch.from_numpy(areas)
    return global_witness(torch.from_numpy(points), areas=given, may_smooth=lambda: False).normals


def test_pose_and_scale_do_not_matter() -> None:
    points, normals = torus(2500)
    for scale, shift in ((1e-3, 0.0), (1e5, 0.0), (1.0, 1e6)):
        assert ((outward(points * scale + shift) * normals).sum(1) > 0).mean() >= 0.99


def test_given_areas_in_other_units_are_understood() -> None:
    points, normals = sphere(2000)
    found = outward(1000 * points, np.full(2000, 4e6 * np.pi / 2000))
    assert ((found * normals).sum(1) > 0).mean() >= 0.99


def test_planes_in_blocks_are_those_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    points, normals = sphere(1000)
    index = local_geometry(points).index
    whole = fit_planes(points, index)
    monkeypatch.setattr("topokit.core.cloud.neighborhoods._ROWS", 64)
    for blocked, expected in zip(fit_planes(points, index), whole, strict=True):
        np.testing.assert_array_equal(blocked, expected)
    assert np.abs((whole[0] * normals).sum(1)).min() > 0.9


@pytest.mark.parametrize("make", [sphere, torus])
def test_given_normals_are_judged(make: Callable[[], Cloud]) -> None:
    points, normals = make()
    local = local_geometry(points)
    complex_ = delaunay_complex(points, local.spacing)
    random = np.random.default_rng(0)
    half = np.where(points[:, :1] > 0.3, -1.0, 1.0)
    few = np.where(random.random((len(points), 1)) < 0.15, -1.0, 1.0)
    tilted = unit(normals + 0.2 * random.normal(size=normals.shape))
    cases = [(1.0, "outward"), (-1.0, "inward"), (half, "mixed"), (few, "mixed")]
    for signs, expected in cases:
        assert check_normals(points, normals * signs, local.areas, local, complex_)[0] == expected
    assert check_normals(points, tilted, local.areas, local, complex_)[0] == "outward"


def test_repeated_points_count_once_and_share_their_normal() -> None:
    points, _ = sphere(1000)
    np.testing.assert_array_equal(outward(np.repeat(points, 12, axis=0)), np.repeat(outward(points), 12, axis=0))


def test_clouds_of_small_parts_alone_have_signs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("topokit.core.cloud.orientation._SMALLEST_PART", 1000)
    assert global_witness(sphere_samples(500).points).euler == 2
