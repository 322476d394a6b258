"""Outliers: points beside a surface are left out, points of surfaces never are, and reports say how many."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.core.cloud import outliers as module
from topokit.core.cloud.outliers import outliers
from topokit.core.cloud.settings import OutlierSettings
from topokit.core.neighbors.kd_tree import without_many_copies
from topokit.testing import genus_mesh, sphere_samples, torus_samples

SURFACES = {
    "a ball": lambda: sphere_samples(3000).points,
    "a torus": lambda: torus_samples(5000).points,
    "a few points": lambda: sphere_samples(40).points,
    "a box with edges": lambda: tk.from_mesh(genus_mesh(2), n_samples=4000).samples.points,
    "two balls of different density": lambda: torch.cat(
        (sphere_samples(4000).points, sphere_samples(200).points + torch.tensor([3.0, 0, 0]))
    ),
    "noise": lambda: (
        sphere_samples(4000).points + 0.01 * torch.randn(4000, 3, generator=torch.Generator().manual_seed(0))
    ),
}

MOST = {"noise": 0.002, "two balls of different density": 0.0005}
"""Share of points that may be taken for outliers."""


def scattered(count: int, size: float) -> torch.Tensor:
    return torch.from_numpy(size * (np.random.default_rng(0).random((count, 3)) - 0.5))


@pytest.mark.parametrize("surface", SURFACES)
def test_points_of_surfaces_stay(surface: str) -> None:
    assert outliers(SURFACES[surface]()).double().mean() <= MOST.get(surface, 0)


@pytest.mark.parametrize(("count", "size", "least"), [(30, 6.0, 0.85), (250, 6.0, 0.95), (1000, 10.0, 0.95)])
def test_points_around_a_surface_are_found(count: int, size: float, least: float) -> None:
    points = torch.cat((torus_samples(5000).points, scattered(count, size)))
    found = outliers(points)
    assert not found[:5000].any()
    assert found[5000:].double().mean() >= least


def test_a_point_that_sticks_out_is_an_outlier_though_its_neighbors_are_near() -> None:
    points = torch.cat((sphere_samples(3000).points, torch.tensor([[0.0, 0.0, 1.15]])))
    assert outliers(points).nonzero().flatten().tolist() == [3000]
    assert not outliers(points, OutlierSettings(isolated=10.0)).any()


def test_a_scatter_without_a_surface_is_left_as_it_is() -> None:
    assert outliers(scattered(20, 1.0)).sum() == 0
    assert outliers(torch.cat((scattered(3000, 1.0), 100 * scattered(5000, 1.0)))).double().mean() <= 0.5


def test_repeated_points_are_no_surface_of_their_own() -> None:
    assert not outliers(torch.zeros(100, 3)).any()
    assert not outliers(sphere_samples(500).points.repeat(10, 1)).any()


def test_a_report_leaves_them_out_and_says_so() -> None:
    points = torch.cat((torus_samples(1500).points, scattered(45, 8.0)))
    report = tk.from_points(points).report()
    assert (report.euler, report.verdict) == (0, "likely")
    [sentence] = [reason for reason in report.reasons if "left out" in reason]
    number = int(sentence.split()[0])
    assert sentence == f"{number} points lie off the surface, far from their neighbors, and were left out."
    assert number == int(outliers(points).sum())


def test_copies_are_looked_up_in_a_small_tree_that_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Points in one place cannot be told apart by a tree: among 100 000 a search took a minute."""
    planted = torch.cat((sphere_samples(1500).points, scattered(100, 6.0)))
    points = torch.cat((planted, planted[:3].repeat(1000, 1), planted[-2:].repeat(5, 1)))
    found = outliers(points)
    assert len(without_many_copies(points.numpy(), 13)) < len(points) - 2900
    assert found.any()
    monkeypatch.setattr(module, "without_many_copies", lambda coordinates, most: np.arange(len(coordinates)))
    assert (outliers(points) == found).all()
