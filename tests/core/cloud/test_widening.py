"""Where votes differ: thin walls and narrow gaps are seen at shifted samples, noisy surfaces at smoothed ones."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from topokit.core.cloud.neighborhoods import local_geometry
from topokit.core.cloud.votes import values_of
from topokit.core.cloud.widening import clearances
from topokit.core.cloud.witness import global_witness


def plate_with_hole(n: int, thickness: float, *, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Random samples (n, 3) of a square plate with a round hole, and outward normals; χ = 0."""
    random = np.random.default_rng(seed)
    half, radius = 1.0, 0.4
    areas = np.array([2 * (4 * half**2 - np.pi * radius**2), 8 * half * thickness, 2 * np.pi * radius * thickness])
    n_faces, n_sides, n_hole = random.multinomial(n, areas / areas.sum())
    flat = random.uniform(-half, half, (3 * n_faces, 2))
    flat = flat[np.hypot(*flat.T) > radius][:n_faces]
    side = random.choice([-1.0, 1.0], n_faces)
    faces = np.column_stack((flat, side * thickness / 2))
    which, along = random.integers(0, 4, n_sides), random.uniform(-half, half, n_sides)
    height, one = random.uniform(-thickness / 2, thickness / 2, n_sides), np.where(which % 2, half, -half)
    x, y = np.where(which < 2, one, along), np.where(which < 2, along, one)
    sides = np.column_stack((x, y, height))
    side_normals = np.column_stack((np.where(which < 2, np.sign(one), 0), np.where(which < 2, 0, np.sign(one)), 0 * x))
    angle = random.uniform(0, 2 * np.pi, n_hole)
    ring = np.column_stack((np.cos(angle), np.sin(angle), 0 * angle))
    hole = radius * ring + np.column_stack((0 * angle, 0 * angle, random.uniform(-1, 1, n_hole) * thickness / 2))
    normals = np.concatenate((side[:, None] * np.array([0, 0, 1.0]), side_normals, -ring))
    return np.concatenate((faces, sides, hole)), normals


def test_clearances_of_parallel_sheets() -> None:
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(12.0), np.arange(12.0)))
    points = np.concatenate([np.column_stack((x, y, 0 * x + height)) for height in (0.0, 0.5)])
    up = np.repeat([[0, 0, 1.0]], len(x), axis=0)
    inner = np.flatnonzero(((points[:, :2] > 2) & (points[:, :2] < 9)).all(1))
    local = local_geometry(points)
    for normals, near, far in (
        (np.concatenate((-up, up)), 0, 1),  # outward: a wall of that thickness
        (np.concatenate((up, -up)), 1, 0),  # inward: a gap of that width
    ):
        found = clearances(points, normals, local)
        distance = found[near][inner] * local.spacings[inner]
        assert np.allclose(distance, 0.5, atol=0.05)
        assert (found[far][inner] == 3).all()


@pytest.mark.parametrize("thickness", [0.01, 0.02])
def test_plate_much_thinner_than_the_spacing(thickness: float) -> None:
    points, normals = plate_with_hole(2_000, thickness)  # spacing 0.06
    witness = global_witness(torch.from_numpy(points), torch.from_numpy(normals))
    assert witness.is_widened
    assert witness.euler == 0
    assert witness.agreement > 0.9


def test_samples_without_signs_stay() -> None:
    points, _ = plate_with_hole(2_000, 0.02)
    assert not global_witness(torch.from_numpy(points)).is_widened


def test_unanimous_votes_are_left_alone() -> None:
    points, normals = plate_with_hole(2_000, 0.4)
    witness = global_witness(torch.from_numpy(points), torch.from_numpy(normals))
    assert not witness.is_widened
    assert (witness.euler, witness.agreement) == (0, 1)


def test_found_normals_are_corrected_where_votes_differ() -> None:
    points, _ = plate_with_hole(2_000, 0.06)
    witness = global_witness(torch.from_numpy(points))
    assert witness.signs.coverage is not None
    assert witness.signs.coverage > 0.97
    assert {vote.family for vote in witness.votes} >= {"cut", "shifted cut"}
    assert witness.euler == 0
    assert witness.agreement > 0.9


def test_noise_leaves_samples_where_they_are() -> None:
    points, normals = plate_with_hole(2_000, 0.06)
    noise = np.random.default_rng(1).normal(0, 0.01, (len(points), 1))
    witness = global_witness(torch.from_numpy(points + noise * normals))
    assert witness.agreement < 1
    assert not witness.is_widened
    assert "shifted cut" not in {vote.family for vote in witness.votes}


@pytest.mark.parametrize("seed", [1, 2])
def test_noisy_samples_whose_votes_differ_are_looked_at_again(seed: int) -> None:
    points, _ = plate_with_hole(2_000, 0.1, seed=seed)
    noisy = points + np.random.default_rng(seed).normal(0, 0.02, points.shape)  # a third of the spacing
    witness = global_witness(torch.from_numpy(noisy))
    assert witness.is_repeated
    assert len(values_of(witness.votes, "field")) == 6  # three of the points, three of the smoothed ones
    assert witness.euler == 0
    assert witness.surface is not None
    assert witness.surface.euler == 0


def test_noisy_samples_whose_votes_agree_are_not() -> None:
    points, _ = plate_with_hole(2_000, 0.5)
    noisy = points + np.random.default_rng(0).normal(0, 0.02, points.shape)
    witness = global_witness(torch.from_numpy(noisy))
    assert witness.quality.coverage < 0.97
    assert witness.agreement == 1
    assert not witness.is_repeated
