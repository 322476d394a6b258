"""Cuts of Delaunay tetrahedra: exact integers of known solids, seen from inside and from outside."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from topokit.core.cloud.normals.patches import Neighborhoods, neighborhoods_of
from topokit.core.cloud.settings import CutWeights, PatchSettings
from topokit.core.cloud.solid.counts import count_parts, solid_eulers
from topokit.core.cloud.solid.tetrahedra import FACETS, cut_complex, delaunay_complex, surface_normals
from topokit.core.mesh.sampling import sample_triangles
from topokit.errors import InputError
from topokit.testing import genus_mesh, sphere_samples, torus_samples

Floats = NDArray[np.float64]

WEIGHTS = CutWeights()


def around(points: Floats) -> Neighborhoods:
    return neighborhoods_of(points, PatchSettings())


def sphere(n_points: int, radius: float = 1.0, shift: float = 0.0) -> tuple[Floats, Floats]:
    known = sphere_samples(n_points, radius)
    return known.points.numpy() + np.array([shift, 0, 0]), known.normals.numpy()


def torus(n_points: int) -> tuple[Floats, Floats]:
    known = torus_samples(n_points)
    return known.points.numpy(), known.normals.numpy()


def double_torus(n_points: int) -> tuple[Floats, Floats]:
    vertices, faces = (torch.as_tensor(part) for part in genus_mesh(2))
    samples, _ = sample_triangles(vertices.double(), faces.long(), n_points)
    assert samples.normals is not None
    return samples.points.numpy(), samples.normals.numpy()


def two_parts(n_points: int) -> tuple[Floats, Floats]:
    parts = zip(sphere(n_points // 2), sphere(n_points // 2, 0.5, 2.0), strict=True)
    points, normals = (np.concatenate(part) for part in parts)
    return points, normals


def shell(n_points: int) -> tuple[Floats, Floats]:
    (outer, out), (inner, away) = sphere(n_points // 2), sphere(n_points // 2, 0.5)
    return np.concatenate((outer, inner)), np.concatenate((out, -away))


SOLIDS = [
    (sphere, 1, (1, 0)),
    (torus, 0, (1, 0)),
    (double_torus, -1, (1, 0)),
    (two_parts, 2, (2, 0)),
    (shell, 2, (1, 1)),
]


@pytest.mark.parametrize(("make", "euler", "parts"), SOLIDS, ids=lambda value: getattr(value, "__name__", str(value)))
def test_known_solids(make: type, euler: int, parts: tuple[int, int]) -> None:
    points, normals = make(4000)
    complex_ = delaunay_complex(points, around(points).spacings)
    cut = cut_complex(complex_, normals, WEIGHTS)
    assert solid_eulers(complex_, cut.inside) == (euler, euler)
    assert count_parts(complex_, cut.inside) == parts
    assert cut.coverage > 0.99
    facing, touched = surface_normals(complex_, cut.inside, normals)
    assert ((facing * normals).sum(1) > 0.5)[touched].mean() > 0.99


def test_wrong_normals_cost_more() -> None:
    points, normals = torus(3000)
    complex_ = delaunay_complex(points, around(points).spacings)
    flipped = normals * np.where(points[:, :1] > 0.3, -1, 1)
    assert cut_complex(complex_, flipped, WEIGHTS).energy > 1.2 * cut_complex(complex_, normals, WEIGHTS).energy


def test_scale_and_position_do_not_matter() -> None:
    points, normals = torus(2000)
    found = []
    for scale, shift in ((1.0, 0.0), (1024.0, 0.0), (2.0**-20, 0.0), (1.0, 4096.0)):
        complex_ = delaunay_complex(points * scale + shift, around(points * scale + shift).spacings)
        cut = cut_complex(complex_, normals, WEIGHTS)
        found.append((*solid_eulers(complex_, cut.inside), round(cut.energy, 2)))
    assert len(set(found)) == 1


def test_parts_of_different_spacing_weigh_the_same() -> None:
    (coarse, out), (fine, away) = sphere(1500), sphere(1500, 0.01, 2.0)
    points, normals = np.concatenate((coarse, fine)), np.concatenate((out, away))
    complex_ = delaunay_complex(points, around(points).spacings)
    cut = cut_complex(complex_, normals, WEIGHTS)
    assert solid_eulers(complex_, cut.inside) == (2, 2)
    assert count_parts(complex_, cut.inside) == (2, 0)
    alone = delaunay_complex(coarse, around(coarse).spacings)
    assert cut.energy == pytest.approx(cut_complex(alone, out, WEIGHTS).energy, rel=0.1)
    blind = delaunay_complex(points, np.full(len(points), around(coarse).spacing))
    assert solid_eulers(blind, cut_complex(blind, normals, WEIGHTS).inside) != (
        2,
        2,
    )  # one unit for all loses the small sphere


def test_samples_in_planes_are_displaced_but_little() -> None:
    side = np.linspace(0, 1, 12)
    points = np.stack(np.meshgrid(side, side, side, indexing="ij"), -1).reshape(-1, 3)
    points = points[(np.abs(points - 0.5) == 0.5).any(1)]
    complex_ = delaunay_complex(points, np.full(len(points), 1 / 11))
    middle = (points.max(0) + points.min(0)) / 2
    shift = np.abs(complex_.points - (points - middle) * 11)
    assert 0 < shift.max() <= 0.02
    again = delaunay_complex(points, np.full(len(points), 1 / 11))
    np.testing.assert_array_equal(complex_.tetrahedra, again.tetrahedra)


def test_a_single_tetrahedron() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    complex_ = delaunay_complex(points, np.full(len(points), 1.0))
    assert len(complex_.tetrahedra) == 1
    assert complex_.facet_area.sum() == pytest.approx(1.5 + 3**0.5 / 2, rel=0.1)  # displaced by up to 2 % of a spacing
    assert solid_eulers(complex_, np.array([True])) == (1, 1)
    assert solid_eulers(complex_, np.array([False])) == (0, 0)


@pytest.mark.parametrize(
    "points", [np.zeros((9, 3)), np.eye(3), np.arange(27.0).reshape(9, 3), np.full((9, 3), np.nan)]
)
def test_flat_input_is_refused(points: Floats) -> None:
    with pytest.raises(InputError, match="volume"):
        delaunay_complex(points, np.full(len(points), 1.0))


def test_facets_and_spheres_are_those_of_each_tetrahedron() -> None:
    complex_ = delaunay_complex(np.random.default_rng(0).normal(size=(60, 3)), np.full(60, 0.7))
    for number, (corners, center) in enumerate(
        zip(complex_.points[complex_.tetrahedra], complex_.centers, strict=True)
    ):
        radius = np.linalg.norm(center - corners[0])
        assert np.allclose(np.linalg.norm(center - corners, axis=1), radius)
        for k, facet in enumerate(FACETS):
            a, b, c = corners[facet]
            normal = np.cross(b - a, c - a)
            normal *= -np.sign(normal @ (corners[k] - a)) / np.linalg.norm(normal)
            assert np.allclose(complex_.facet_normal[number, k], normal)
            squared = complex_.spacing[complex_.tetrahedra[number, facet]] ** 2
            area = np.linalg.norm(np.cross(b - a, c - a)) / 2 / squared.mean()
            assert complex_.facet_area[number, k] == pytest.approx(area)
            other = complex_.neighbors[number, k]
            cosines = [(a - center) @ normal / radius]
            if other >= 0:
                shared = set(complex_.tetrahedra[other]) & set(complex_.tetrahedra[number])
                assert shared == set(complex_.tetrahedra[number, facet])
                way = a - complex_.centers[other]
                cosines.append(-way @ normal / np.linalg.norm(way))
            assert complex_.sphere_cost[number, k] == pytest.approx((1 - min(cosines)) / 2)


def test_tetrahedra_near_each_other_have_near_numbers() -> None:
    complex_ = delaunay_complex(np.random.default_rng(0).random((3000, 3)), np.full(3000, 0.07))
    here = np.arange(len(complex_.tetrahedra))[:, None]
    steps = np.abs(complex_.neighbors - here)[complex_.neighbors >= 0]
    assert np.quantile(steps, 0.75) < 0.01 * len(here)  # in the order of Qhull 0.11
