"""Patches of a cut without samples: lids over holes, of known size and place."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import trimesh
from numpy.typing import NDArray

from topokit.core.cloud.normals.patches import neighborhoods_of
from topokit.core.cloud.settings import CutWeights, PatchSettings, QualitySettings
from topokit.core.cloud.solid.tetrahedra import cut_complex, delaunay_complex
from topokit.core.cloud.solid.uncovered import UncoveredPatch, uncovered_patches
from topokit.testing import sphere_samples, torus_samples

Floats = NDArray[np.float64]
WEIGHTS = CutWeights()
QUALITY = QualitySettings()
RANDOM = 25  # more samples than this are never missing between random ones


def patches_of(points: Floats, normals: Floats) -> tuple[UncoveredPatch, ...]:
    complex_ = delaunay_complex(points, neighborhoods_of(points, PatchSettings()).spacings)
    return uncovered_patches(complex_, cut_complex(complex_, normals, WEIGHTS).inside, points, normals, QUALITY)


def sphere(n_points: int, seed: int = 0) -> Floats:
    return sphere_samples(n_points, generator=torch.Generator().manual_seed(seed)).points.numpy()


@pytest.mark.parametrize("seed", range(5))
def test_gaps_between_random_samples_are_small(seed: int) -> None:
    points = sphere(3000, seed)
    missing = [patch.missing for patch in patches_of(points, points)]
    assert missing == sorted(missing, reverse=True)
    assert max(missing, default=0.0) < RANDOM


def test_a_lid_misses_as_many_samples_as_its_area_would_hold() -> None:
    points = sphere(4000)
    kept = points[points[:, 2] < 0.8]
    lid = patches_of(kept, kept)[0]
    disc = 4000 * math.pi * (1 - 0.8**2) / (4 * math.pi)  # the flat lid is a disc of radius 0.6
    assert 0.5 * disc < lid.missing < disc  # spacings at a rim, where half of the neighbors are missing, are too wide
    assert 0.8 * lid.missing < lid.empty <= lid.missing
    assert kept[lid.samples][:, 2].min() > 0.8 - 0.1


def test_the_ends_of_a_tube_are_two_lids() -> None:
    known = torus_samples(6000)
    kept = (known.points[:, 1] > 0).numpy()
    points, normals = known.points.numpy()[kept], known.normals.numpy()[kept]
    lids = [patch for patch in patches_of(points, normals) if patch.missing > RANDOM]
    assert sorted(np.sign(points[lid.samples].mean(0)[0]) for lid in lids) == [-1, 1]


def test_a_long_narrow_strip_counts_although_no_place_in_it_is_far_from_samples() -> None:
    points = sphere(8000)
    spacing = (4 * math.pi / 8000) ** 0.5
    cut_out = (np.abs(points[:, 2]) < 2.2 * spacing) & (points[:, 0] > 0)
    lids = patches_of(points[~cut_out], points[~cut_out])
    assert lids[0].missing > 2 * RANDOM


def test_points_between_sparse_samples_cover_the_surface() -> None:
    points = sphere(20_000)
    sparse = (points[:, 2] < 0.8) | (np.arange(len(points)) % 10 == 0)
    samples = points[sparse]
    complex_ = delaunay_complex(samples, np.full(len(samples), (4 * math.pi / len(points)) ** 0.5))
    inside = cut_complex(complex_, samples, WEIGHTS).inside
    assert uncovered_patches(complex_, inside, samples, samples, QUALITY)[0].missing > 2 * RANDOM
    covered = uncovered_patches(complex_, inside, points, samples, QUALITY)
    assert max((patch.missing for patch in covered), default=0.0) < RANDOM


def test_the_end_of_a_cut_wall_faces_where_no_sample_does() -> None:
    """No place of it is more than 1.25 spacings from a sample."""
    plate = trimesh.creation.box((40.0, 40.0, 2.5))
    points, face = trimesh.sample.sample_surface(plate, round(plate.area), seed=0)
    normals = plate.face_normals[face]
    assert max((patch.missing for patch in patches_of(points, normals)), default=0.0) < RANDOM
    kept = points[:, 0] < 10
    lid = patches_of(points[kept], normals[kept])[0]
    assert RANDOM < lid.missing < 40 * 2.5
    assert lid.empty < RANDOM
    assert points[kept][lid.samples][:, 0].min() > 10 - 4
