"""Planar caps over the holes of an open cloud."""

from __future__ import annotations

import math

import numpy as np
import pytest

from topokit.core.arrays import Booleans, Floats
from topokit.core.cloud.caps import OrientedLayer, flat_share, planar_caps
from topokit.testing import AnalyticSamples, sphere_samples, torus_samples

DOWN = np.array([0.0, 0.0, -1.0])


def layer_of(known: AnalyticSamples, kept: Booleans | slice = slice(None)) -> OrientedLayer:
    """Samples of uniform density that are kept, with their normals."""
    points, normals = (part.numpy()[kept] for part in (known.points, known.normals))
    return OrientedLayer(points, normals, np.full(len(points), float(known.area) / len(known.points)))


def lid_at(height: float, half: float = 2.0) -> Floats:
    """Two triangles that span a square in a horizontal plane, seen from below."""
    corners = np.array([[-half, -half, height], [-half, half, height], [half, half, height], [half, -half, height]])
    return corners[[[0, 1, 2], [0, 2, 3]]]


def test_winding_numbers_of_a_sphere() -> None:
    layer = layer_of(sphere_samples(4000))
    inside, outside = np.array([[0.0, 0, 0], [0.3, -0.2, 0.5]]), np.array([[0.0, 0, 2], [1.5, 1, 0]])
    assert layer.winding_numbers(inside) == pytest.approx(1, abs=0.02)
    assert layer.winding_numbers(outside) == pytest.approx(0, abs=0.02)
    assert layer.winding_numbers(np.zeros((0, 3))).shape == (0,)


def test_lids_are_flat_where_they_lie_near_the_outermost_plane() -> None:
    flat, higher = lid_at(-1.0), lid_at(-0.9, half=1.0)
    assert flat_share(flat, spacing=0.01) == pytest.approx(1)
    assert flat_share(np.concatenate((flat, higher)), spacing=0.1) == pytest.approx(1)
    assert flat_share(np.concatenate((flat, higher)), spacing=0.01) == pytest.approx(16 / 20)
    slope = flat.copy()
    slope[0, 1, 2] = 0.0  # one of two triangles rises
    assert flat_share(slope, spacing=0.01) < 0.6


@pytest.mark.parametrize("height", [-0.8, -0.4, 0.0])
def test_a_sphere_that_was_cut_off_ends_in_a_disc(height: float) -> None:
    known = sphere_samples(2000)
    layer = layer_of(known, known.points[:, 2].numpy() > height)
    caps, normals = planar_caps(layer, [lid_at(height)])
    radius = math.sqrt(1 - height**2)
    across = np.linalg.norm(caps[:, :2], axis=1)
    assert caps[:, 2] == pytest.approx(height)
    assert normals == pytest.approx(np.broadcast_to(DOWN, normals.shape))
    assert across.max() < radius + layer.spacing  # gaps between random samples of the rim are as wide
    assert len(caps) * layer.spacing**2 == pytest.approx(math.pi * (radius - layer.spacing / 2) ** 2, rel=0.15)


def test_under_a_torus_that_lies_on_a_table_is_a_ring() -> None:
    known = torus_samples(3000)  # radii 1 and 0.4
    height = -0.2
    layer = layer_of(known, known.points[:, 2].numpy() > height)
    caps, _ = planar_caps(layer, [lid_at(height)])
    across, half = np.linalg.norm(caps[:, :2], axis=1), math.sqrt(0.4**2 - 0.2**2) + layer.spacing
    assert 1 - half < across.min() < across.max() < 1 + half
    angle = np.arctan2(caps[:, 1], caps[:, 0])
    assert np.histogram(angle, bins=12, range=(-np.pi, np.pi))[0].min() > 0.5 * len(caps) / 12


def test_two_ends_of_a_tube_are_capped_one_after_the_other() -> None:
    known = sphere_samples(2000)
    layer = layer_of(known, np.abs(known.points[:, 2].numpy()) < 0.5)
    caps, normals = planar_caps(layer, [lid_at(-0.5), lid_at(0.5)[:, ::-1]])
    assert sorted({round(float(height), 6) for height in caps[:, 2]}) == [-0.5, 0.5]
    assert (normals[:, 2] * caps[:, 2] > 0).all()
    assert np.linalg.norm(caps[:, :2], axis=1).max() < math.sqrt(0.75) + layer.spacing


def test_nothing_is_missing_where_a_plane_misses_or_cuts_a_closed_surface() -> None:
    layer = layer_of(sphere_samples(2000))
    for height in (-1.5, -1.0, 0.0):
        caps, normals = planar_caps(layer, [lid_at(height)])
        assert caps.shape == normals.shape
        assert (np.abs(np.linalg.norm(caps, axis=1) - 1) < 2 * layer.spacing).all()  # gaps between random samples
