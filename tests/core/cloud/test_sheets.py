"""Open clouds read by the union of balls around them."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

import topokit as tk
from topokit.core.cloud.settings import WireSettings
from topokit.core.cloud.sheets import SheetReading, read_sheet
from topokit.core.neighbors import nearest_neighbors
from topokit.testing import sphere_samples, torus_samples


def moebius(n_points: int) -> Tensor:
    around, across = torch.rand(2, n_points, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    around, across = 2 * math.pi * around, 0.8 * (across - 0.5)
    out = 1 + across * (around / 2).cos()
    return torch.stack((out * around.cos(), out * around.sin(), across * (around / 2).sin()), dim=1)


def reading(points: Tensor) -> SheetReading:
    found = read_sheet(points, nearest_neighbors(points, 20), WireSettings())
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("points", "euler", "components", "closed"),
    [
        (sphere_samples(3000).points, 2, 1, 1),
        (torus_samples(3000).points, 0, 1, 1),
        (torus_samples(3000).points[::2][torus_samples(3000).points[::2, 1] > 0], 0, 1, 0),
        (moebius(3000), 0, 1, 0),
        (torch.cat((sphere_samples(2000).points, moebius(2000) + 3)), 2, 2, 1),
    ],
    ids=["sphere", "torus", "half a torus", "Möbius strip", "sphere and strip"],
)
def test_the_union_of_balls_has_the_homotopy_type_of_the_surface(
    points: Tensor, euler: int, components: int, closed: int
) -> None:
    found = reading(points)
    assert found.shares[euler] > 0.8
    assert sum(found.shares.values()) == pytest.approx(1)
    assert list(found.shares.values()) == sorted(found.shares.values(), reverse=True)
    assert (found.components, found.closed) == (components, closed)


def test_copies_and_few_points() -> None:
    points = moebius(1500)
    assert next(iter(reading(points.repeat(2, 1)).shares)) == next(iter(reading(points).shares)) == 0
    few = moebius(20).repeat(5, 1)
    assert read_sheet(few, nearest_neighbors(few, 20), WireSettings()) is None


def test_a_strip_that_is_not_orientable_has_no_genus() -> None:
    report = tk.from_points(moebius(2000)).report()
    assert (report.euler, report.closed, report.genus, report.boundary_loops) == (0, False, None, 1)
    assert report.verdict == "unsure"
    assert any("union of balls" in reason for reason in report.reasons[: report.n_deciding])
