"""What no surface can be read from is refused: planes, filled space, strays; surfaces are not."""

from __future__ import annotations

import re

import numpy as np
import pytest
import torch

import topokit
from topokit.core.cloud.guards import (
    FEWEST_POINTS,
    centered_positions,
    far_points,
    is_flat,
    least_roundness,
    refuse_filled_space,
)
from topokit.core.cloud.settings import CloudSettings, GuardSettings
from topokit.core.cloud.witness import global_witness
from topokit.errors import InputError
from topokit.testing import sphere_samples, torus_samples

N_POINTS = 12_000
SETTINGS = GuardSettings()
PROBES = CloudSettings().sampling.probes


def random_ball(n_points: int = N_POINTS) -> np.ndarray:
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(n_points, 3))
    return direction / np.linalg.norm(direction, axis=1, keepdims=True) * rng.random((n_points, 1)) ** (1 / 3)


def blobs() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    side = np.arange(23.0)
    return {
        "ball": random_ball(),
        "Gaussian": rng.normal(size=(N_POINTS, 3)),
        "box": rng.random((N_POINTS, 3)) * [1.0, 1.0, 0.7],
        "two scales": np.concatenate((rng.normal(size=(N_POINTS, 3)), 0.01 * rng.normal(size=(N_POINTS, 3)))),
        "lattice": np.stack(np.meshgrid(side, side, side), -1).reshape(-1, 3),
    }


def surfaces() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    direction, torus = sphere_samples(N_POINTS).points.numpy(), torus_samples(N_POINTS).points.numpy()
    square = rng.uniform(-1, 1, (N_POINTS, 3))
    return {
        "sphere": direction,
        "torus with noise of two spacings": torus + 0.05 * rng.normal(size=torus.shape),
        "thick sphere": direction * rng.normal(1, 0.1, (N_POINTS, 1)),
        "plate": square * [1, 1, 0.05],
        "sphere among stray points": np.concatenate((direction[::2], 2 * square[::2])),
        "rod": square * [1, 0.03, 0.03],
    }


@pytest.mark.parametrize("name", blobs())
def test_blobs_fill_space(name: str) -> None:
    points = blobs()[name]
    with pytest.raises(InputError, match=f"{len(points)} points fill space"):
        refuse_filled_space(points, PROBES, SETTINGS)


@pytest.mark.parametrize("name", surfaces())
def test_surfaces_do_not(name: str) -> None:
    assert least_roundness(surfaces()[name], PROBES, SETTINGS) < 0.45
    refuse_filled_space(surfaces()[name], PROBES, SETTINGS)


@pytest.mark.parametrize("n_points", [2000, 8000, 60_000])
def test_a_noisy_ring_is_as_round_whatever_the_number_of_points(n_points: int) -> None:
    points = torus_samples(n_points, minor=0.15).points.numpy()
    points = points + 0.05 * np.random.default_rng(0).normal(size=points.shape)
    assert least_roundness(points, PROBES, SETTINGS) == pytest.approx(0.467, abs=0.015)


def test_few_points_are_never_refused() -> None:
    points = random_ball(3000)
    refuse_filled_space(points, PROBES, SETTINGS)
    few = GuardSettings(fewest_in_space=3000)
    with pytest.raises(InputError, match="3000"):
        refuse_filled_space(points, PROBES, few)
    with pytest.raises(InputError, match="3000"):
        global_witness(torch.from_numpy(points), settings=CloudSettings(guards=few))


def test_the_order_of_the_points_hardly_matters() -> None:
    points = surfaces()["torus with noise of two spacings"]
    along = points[np.lexsort(points.T)]
    assert least_roundness(along, PROBES, SETTINGS) == pytest.approx(
        least_roundness(points, PROBES, SETTINGS), abs=0.05
    )


def test_the_report_of_a_blob_says_why_there_is_no_solid() -> None:
    report = topokit.from_points(torch.from_numpy(random_ball())).report()
    assert (report.verdict, report.closed, report.genus) == ("unsure", False, None)
    assert re.search(r"the 1[12]\d{3} points fill space", report.reasons[0])  # some at the rim are taken for outliers


@pytest.mark.parametrize("distance", [29.0, 31.0])
def test_stray_points_are_far_beyond_thirty_times_the_others(distance: float) -> None:
    points = torch.cat((sphere_samples(1000).points, distance * torch.eye(3, dtype=torch.float64)))
    far = far_points(points)
    assert far.sum() == (3 if distance > SETTINGS.far else 0)
    assert not far[:1000].any()
    assert far_points(points, GuardSettings(far=20.0)).sum() == 3


def test_many_far_points_are_a_part_of_the_scene() -> None:
    near, other = sphere_samples(1000).points, sphere_samples(FEWEST_POINTS).points
    assert far_points(torch.cat((near, other[1:] + 100))).sum() == FEWEST_POINTS - 1
    assert not far_points(torch.cat((near, other + 100))).any()  # enough to bound a solid
    assert not far_points(torch.zeros(50, 3)).any()


def test_flat_is_a_millionth_of_the_length() -> None:
    square = np.random.default_rng(0).uniform(-1, 1, (500, 3))
    turned = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    assert is_flat(square * [1, 1, 1e-7] @ turned)
    assert not is_flat(square * [1, 1, 1e-5] @ turned)
    assert is_flat(np.ones((9, 3)))


def test_positions_are_centered_in_whole_units_and_exact() -> None:
    points = sphere_samples(500).points.numpy()
    positions, unit_length = centered_positions(points)
    np.testing.assert_array_equal(positions * unit_length, points)  # around the origin nothing is subtracted
    moved, same = centered_positions(points * 2.0**20 + 2.0**22)
    assert same == unit_length * 2.0**20
    assert np.abs(moved).max() <= 2
    np.testing.assert_allclose(np.ptp(moved, axis=0), np.ptp(positions, axis=0))
