"""Nearest neighbors where many points coincide."""

from __future__ import annotations

import torch

from topokit.core.neighbors import nearest_neighbors


def test_many_points_in_one_place_are_neighbors_of_each_other() -> None:
    generator = torch.Generator().manual_seed(0)
    scattered = torch.rand(500, 3, generator=generator, dtype=torch.float64)
    points = torch.cat((scattered, torch.full((2500, 3), 2.0, dtype=torch.float64)))
    points = points[torch.randperm(len(points), generator=generator)]
    found = nearest_neighbors(points, 6)
    distance = (points[found] - points[:, None]).norm(dim=2)
    known = torch.cdist(points, points).topk(7, largest=False).values[:, 1:]
    torch.testing.assert_close(distance, known, atol=1e-6, rtol=0)
    assert (found != torch.arange(len(points))[:, None]).all()
    assert all(len(set(row)) == 6 for row in found.tolist())
