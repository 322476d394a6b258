"""Samples that are too close to each other to be independent."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from topokit.core.neighbors import nearest_neighbors
from topokit.core.separation import close_pairs, separate


def square(n_points: int, seed: int = 0) -> Tensor:
    """Random points of a square, one per unit of area."""
    corner = torch.rand(n_points, 2, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return torch.nn.functional.pad(corner * math.sqrt(n_points), (0, 1))


def two_scans(shift: float) -> Tensor:
    points = square(2000)
    return torch.cat((points, points + points.new_tensor([shift, 0.0, 0.0])))


def crowd(points: Tensor, normals: Tensor | None = None) -> float:
    rows = torch.arange(0, len(points), 3)
    own = close_pairs(points, rows, nearest_neighbors(points, 20)[rows], normals)[0]
    assert set(own.tolist()) <= set(rows.tolist())
    return len(own) / len(rows)


def test_two_scans_are_more_crowded_than_random_samples() -> None:
    assert 0.6 < crowd(square(4000)) < 0.78
    assert crowd(two_scans(1 / 6)) > 1.4
    assert crowd(two_scans(1 / 3)) > 0.9


def test_opposite_sides_of_a_wall_are_not_close() -> None:
    points = two_scans(0.0) + torch.tensor([[0.0, 0.0, 0.1]]).double() * (torch.arange(4000) >= 2000)[:, None]
    normals = torch.zeros(4000, 3).double()
    normals[:, 2] = torch.where(torch.arange(4000) < 2000, -1.0, 1.0)
    assert crowd(points) > 1.4
    assert crowd(points, normals) < 0.8


def test_one_of_each_pair_is_left() -> None:
    points = two_scans(1 / 100)
    kept = separate(points, nearest_neighbors(points, 8))
    assert (kept.diff() > 0).all()
    assert torch.cdist(points[kept], points[kept]).fill_diagonal_(9.0).min() > 1 / 100
    assert 1000 < len(kept) < 2000
    assert torch.cdist(points, points[kept]).amin(1).max() < 2  # each point has a kept one near it


def test_the_order_of_the_samples_does_not_matter() -> None:
    points = two_scans(1 / 6)
    order = torch.randperm(len(points), generator=torch.Generator().manual_seed(0))
    kept, again = (cloud[separate(cloud, nearest_neighbors(cloud, 8))] for cloud in (points, points[order]))
    assert sorted(kept.tolist()) == sorted(again.tolist())


def test_few_samples_all_stay() -> None:
    points = torch.tensor([[0.0], [0.001], [1.0], [1.001], [5.0]]).expand(5, 3)
    assert len(separate(points, nearest_neighbors(points, 4))) == 5
