"""Outward normals found for clouds without any."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from sample_arrays import Cloud, Floats, sphere, torus

from topokit.core.cloud.guards import FEWEST_POINTS
from topokit.core.cloud.normals.patches import patches_of
from topokit.core.cloud.reconstruction import Cloud as Distinct
from topokit.core.cloud.reconstruction import Reconstruction, reconstruct
from topokit.core.cloud.settings import CloudSettings, OrientationSettings, SamplingSettings, SignSettings
from topokit.core.cloud.witness import global_witness
from topokit.core.mesh.sampling import sample_triangles
from topokit.testing import sphere_samples, torus_samples


def nested_spheres() -> Cloud:
    """A hollow ball: the normals of its inner wall point into the cavity."""
    points, normals = sphere(2000)
    inner = sphere(1000)[0]
    return np.concatenate((points, 0.55 * inner)), np.concatenate((normals, -inner))


def linked_tori() -> Cloud:
    thinner = torus_samples(2000, minor=0.25)
    points, normals = thinner.points.numpy(), thinner.normals.numpy()
    turned = [0, 2, 1]
    other = points[:, turned] + np.array([1.0, 0, 0])
    return np.concatenate((points, other)), np.concatenate((normals, normals[:, turned]))


def box() -> Cloud:
    corners = torch.cartesian_prod(*[torch.tensor([0.0, side]).double() for side in (1.0, 0.6, 0.3)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = torch.tensor([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])
    samples, _ = sample_triangles(corners, faces, 2500)
    assert samples.normals is not None
    return samples.points.numpy(), samples.normals.numpy()


SETTINGS = CloudSettings()
BY_FIELDS = CloudSettings(signs=SignSettings(roughness=-1.0))  # no signs are carried


SHAPES = (sphere, torus, nested_spheres, linked_tori, box)


@cache
def look(make: Callable[[], Cloud], settings: CloudSettings = SETTINGS) -> Reconstruction:
    points = make()[0]
    return reconstruct(Distinct(points, None, oriented=True), patches_of(points, settings.patches), settings)


@pytest.mark.parametrize(
    ("make", "settings"),
    [
        *(pytest.param(make, SETTINGS, id=f"{make.__name__}, carried") for make in SHAPES),
        pytest.param(torus, BY_FIELDS, id="torus, fields"),
        pytest.param(box, BY_FIELDS, id="box, fields"),
        *(
            pytest.param(make, BY_FIELDS, id=f"{make.__name__}, fields", marks=pytest.mark.long)
            for make in (sphere, nested_spheres, linked_tori)
        ),
    ],
)
def test_unoriented_clouds_are_oriented(make: Callable[[], Cloud], settings: CloudSettings) -> None:
    normals, found = make()[1], look(make, settings).found
    assert found is not None
    assert ((found.normals * normals).sum(1) > 0).mean() >= 0.99
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1)
    assert found.coverage > 0.97
    assert len(found.trials) > 1 or settings is SETTINGS
    assert found.trials[0].cut.coverage == found.coverage


def test_signs_that_are_not_believed_compete_with_those_of_fields() -> None:
    """None are if the implied solid must cover more than all samples, and then the cheapest solid wins."""
    normals = torus()[1]
    strict = CloudSettings(orientation=OrientationSettings(believed=1.1))
    carried, found = (look(torus, settings).found for settings in (SETTINGS, strict))
    assert carried is not None
    assert found is not None
    assert len(carried.trials) == 1 < len(found.trials)
    costs = [trial.cost(SETTINGS.orientation.coverage_power) for trial in found.trials]
    assert costs == sorted(costs)
    assert ((found.normals * normals).sum(1) > 0).all()


def test_candidates_without_hope_are_not_corrected() -> None:
    normals, seen = torus()[1], look(torus, BY_FIELDS)
    found, complex_, own = seen.found, seen.cloud.complex_, BY_FIELDS.orientation
    assert found is not None
    best = found.corrected(complex_, None, BY_FIELDS)
    assert ((best.normals * normals).sum(1) > 0).all()
    assert best.cut.coverage >= found.coverage
    costs = [trial.cost(own.coverage_power) for trial in found.trials]
    only = found.corrected(complex_, None, replace(BY_FIELDS, orientation=OrientationSettings(hopeless=1.0)))
    assert only.cost() >= best.cost()
    assert len(costs) > 1


def outward(points: Floats) -> Floats:
    return global_witness(torch.from_numpy(points)).normals


def test_pose_and_scale_do_not_matter() -> None:
    points, normals = torus(1200)
    for scale, shift in ((1e-3, 0.0), (1e5, 0.0), (1.0, 1e6)):
        assert ((outward(points * scale + shift) * normals).sum(1) > 0).mean() >= 0.99


def test_repeated_points_count_once_and_share_their_normal() -> None:
    points, _ = sphere(1000)
    np.testing.assert_array_equal(outward(np.repeat(points, 12, axis=0)), np.repeat(outward(points), 12, axis=0))


def test_clouds_of_small_parts_alone_have_signs() -> None:
    """Of parts with fewer points than bound a solid, none is looked at by itself."""
    part = sphere_samples(FEWEST_POINTS - 1).points
    points = torch.cat([part + torch.tensor([4.0 * k, 0, 0]) for k in range(4)])
    found = global_witness(points)
    assert found.components == 4
    assert ((torch.from_numpy(found.normals) * part.repeat(4, 1)).sum(1) > 0).double().mean() > 0.95


@pytest.mark.parametrize("is_large", [False, True])
def test_a_small_bubble_in_a_solid_is_a_cavity(is_large: bool) -> None:
    """Its normals, carried along its own surface, point out of the bubble and not into it."""
    settings = CloudSettings(sampling=SamplingSettings(whole=1500, samples=1000)) if is_large else SETTINGS
    bubble = 0.12 * sphere_samples(60).points + torch.tensor([0.3, 0, 0])
    found = global_witness(torch.cat((sphere_samples(2000).points, bubble)), settings=settings)
    assert (found.euler, found.components, found.cavities) == (4, 1, 1)
    inward = torch.tensor([0.3, 0, 0]) - bubble
    assert ((torch.from_numpy(found.normals)[-60:] * inward).sum(1) > 0).double().mean() > 0.99


def test_distant_small_parts_are_turned_outward_and_counted() -> None:
    """Ten spheres of radius 1 … 0.01 in a row."""
    parts, place = [], 0.0
    for number, radius in enumerate(np.geomspace(1, 0.01, 10)):
        own = sphere_samples(300, generator=torch.Generator().manual_seed(number)).points
        parts.append(radius * own + torch.tensor([place + radius, 0, 0]))
        place += 4 * radius
    points, middles = torch.cat(parts), torch.cat([part.mean(0).expand_as(part) for part in parts])
    found = global_witness(points)
    assert (found.euler, found.components, found.cavities) == (20, 10, 0)
    assert found.agreement > 0.7
    assert ((torch.from_numpy(found.normals) * (points - middles)).sum(1) > 0).double().mean() > 0.99
