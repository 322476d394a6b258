"""Points that fill space are told from points on surfaces, however noisy or thin-walled."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import topokit
from topokit.core.cloud.solidity import fills_space, least_roundness
from topokit.testing import sphere_samples, torus_samples

N_POINTS = 12_000


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
    assert fills_space(blobs()[name]), least_roundness(blobs()[name])


@pytest.mark.parametrize("name", surfaces())
def test_surfaces_do_not(name: str) -> None:
    assert least_roundness(surfaces()[name]) < 0.45


def test_few_points_are_never_refused() -> None:
    assert not fills_space(random_ball(3000))


def test_the_order_of_the_points_hardly_matters() -> None:
    points = surfaces()["torus with noise of two spacings"]
    along = points[np.lexsort(points.T)]
    assert least_roundness(along) == pytest.approx(least_roundness(points), abs=0.05)


def test_the_report_of_a_blob_says_why_there_is_no_solid() -> None:
    report = topokit.from_points(torch.from_numpy(random_ball())).report()
    assert (report.verdict, report.closed, report.genus) == ("unsure", False, None)
    assert "the 12000 points fill space" in report.reasons[0]
