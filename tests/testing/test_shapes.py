"""The analytic test shapes: points, normals and curvatures against each other and against the estimates."""

from __future__ import annotations

import math

import pytest
import torch
from scipy.spatial import cKDTree

from topokit.core.local.boundary import estimate_boundary
from topokit.core.local.curvature import surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.mesh.topology import mesh_topology
from topokit.core.samples import SurfaceSamples
from topokit.testing import (
    AnalyticSamples,
    cylinder_samples,
    hemisphere_samples,
    linked_tori_mesh,
    linked_tori_samples,
    plate_samples,
    shell_mesh,
    shell_samples,
)

SHAPES = {
    "hemisphere": (hemisphere_samples(6000), 1),
    "cylinder": (cylinder_samples(6000), 2),
    "plate with a hole": (plate_samples(6000), 2),
    "plate": (plate_samples(6000, hole=0.0), 1),
    "shell": (shell_samples(6000, thickness=0.3), 0),
    "linked tori": (linked_tori_samples(6000), 0),
}


@pytest.mark.parametrize("name", SHAPES)
def test_curvature_area_and_euler_are_what_the_samples_say(name: str) -> None:
    known, loops = SHAPES[name]
    local = surface_curvature(SurfaceSamples(known.points, known.normals))
    inside = ~local.is_boundary
    scale = 1 + known.gaussian.abs().median()
    assert float((local.gaussian - known.gaussian)[inside].abs().median()) < 0.05 * float(scale)
    assert float((local.mean - known.mean)[inside].abs().median()) < 0.05 * float(1 + known.mean.abs().median())
    assert float(local.area.sum()) == pytest.approx(known.area, rel=0.02)
    boundary = estimate_boundary(known.points, local.neighbors)
    assert len(boundary.curves) == loops
    assert float(euler_characteristic(local.gaussian, local.area)) + boundary.euler == pytest.approx(
        known.euler, abs=0.3
    )


def test_shells_face_away_from_their_solid() -> None:
    known = shell_samples(500, radius=2.0, thickness=0.5)
    along = (known.points * known.normals).sum(1)
    radii = known.points.norm(dim=1)
    torch.testing.assert_close(radii, torch.where(along > 0, 2.0, 1.5).double())
    assert known.area == pytest.approx(4 * math.pi * (4 + 2.25))


def test_linked_tori_do_not_touch() -> None:
    known = linked_tori_samples(4000)
    first, second = known.points[:2000].numpy(), known.points[2000:].numpy()
    assert cKDTree(first).query(second)[0].min() > 0.4
    inside = second[abs(second[:, 2]) < 0.25]
    assert (abs((inside**2).sum(1) ** 0.5) < 0.8).any(), "the second ring passes through the hole of the first"


@pytest.mark.parametrize(("mesh", "euler", "components"), [(shell_mesh(2), 4, 2), (linked_tori_mesh(20, 10), 0, 2)])
def test_compound_meshes_are_closed_and_face_outward(mesh: tuple, euler: int, components: int) -> None:
    vertices, faces = mesh
    topology = mesh_topology(vertices, faces)
    assert (topology.euler, len(topology.components), topology.is_closed) == (euler, components, True)
    corners = torch.from_numpy(vertices)[torch.from_numpy(faces.copy())]
    volume = float((corners[:, 0] * torch.linalg.cross(corners[:, 1], corners[:, 2])).sum()) / 6
    solid = 4 / 3 * math.pi * (1 - 0.9**3) if euler == 4 else 2 * 2 * math.pi**2 * 0.25**2
    assert volume == pytest.approx(solid, rel=0.1)


def test_samples_are_reproducible_and_follow_their_generator() -> None:
    def points(seed: int | None) -> AnalyticSamples:
        return linked_tori_samples(50, generator=None if seed is None else torch.Generator().manual_seed(seed))

    assert torch.equal(points(None).points, points(0).points)
    assert not torch.equal(points(1).points, points(0).points)
