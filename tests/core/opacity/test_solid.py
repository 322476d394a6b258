"""The solid that cannot be seen into."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from topokit.core.mesh.topology import mesh_topology
from topokit.core.opacity.solid import Gaussians, grid_around, read_opacity, typical_spacing
from topokit.testing import torus_samples


def balls(points: Tensor, width: float, depth: float = 3.0) -> Gaussians:
    """Round Gaussians that absorb a depth along a ray through the middle."""
    count = len(points)
    covariances = width**2 * torch.eye(3, dtype=torch.float64).expand(count, 3, 3)
    integrals = torch.full((count,), depth * 2 * math.pi * width**2, dtype=torch.float64)
    return Gaussians(points.double(), covariances, integrals, torch.ones(count, dtype=torch.bool))


def sphere(count: int, seed: int = 0) -> Tensor:
    points = torch.randn(count, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return torch.nn.functional.normalize(points, dim=1)


def even_sphere(count: int) -> Tensor:
    """A spiral on the sphere."""
    height = 1 - 2 * (torch.arange(count, dtype=torch.float64) + 0.5) / count
    angle = torch.arange(count, dtype=torch.float64) * math.pi * (3 - math.sqrt(5))
    width = (1 - height**2).sqrt()
    return torch.stack((width * angle.cos(), width * angle.sin(), height), dim=1)


def test_a_torus_of_balls_has_a_tunnel_and_its_surface_says_so() -> None:
    found = read_opacity(balls(torus_samples(3_000).points, 0.05))
    assert (found.euler, found.share) == (0, 1.0)
    assert found.hidden < 0.02
    topology = mesh_topology(found.surface.vertices, found.surface.faces)
    assert topology.is_closed
    assert (topology.euler, len(topology.components)) == (0, 1)
    assert 0.1 < found.resolution < 0.6  # the tube is 0.8 wide, the tunnel 1.2
    assert read_opacity(balls(torus_samples(3_000).points, 0.05), finer_than=0.05) is None


def test_walls_that_nobody_sees_are_told() -> None:
    inner = 0.5 * even_sphere(500)
    found = read_opacity(balls(torch.cat((even_sphere(2_000), inner)), 0.05))
    assert found.euler == 2  # the cavity is filled
    assert found.hidden == pytest.approx(0.2, abs=0.01)


def test_what_lets_light_through_is_no_solid() -> None:
    assert read_opacity(balls(even_sphere(2_000), 0.05, depth=0.02)) is None


def test_pieces_smaller_than_what_can_be_seen_are_dropped() -> None:
    speck = torch.tensor([[3.0, 0, 0]], dtype=torch.float64)
    found = read_opacity(balls(torch.cat((even_sphere(2_000), speck)), 0.05))
    assert (found.euler, found.share) == (2, 1.0)


@pytest.mark.parametrize("unit", [1e-30, 100.0, 1e120])
def test_it_is_the_same_in_another_unit_and_place(unit: float) -> None:
    one = balls(sphere(800), 0.09)
    scaled = Gaussians(unit * (one.means + 7), unit**2 * one.covariances, unit**2 * one.integrals, one.is_disc)
    first, second = read_opacity(one), read_opacity(scaled)
    assert first.eulers == second.eulers
    assert second.resolution == pytest.approx(unit * first.resolution, rel=1e-6)
    middle = second.surface.vertices.mean(0) / unit
    np.testing.assert_allclose(middle, first.surface.vertices.mean(0) + 7, atol=1e-6)


def test_grids_are_limited_and_hold_all_points() -> None:
    points = torch.tensor([[0.0, 0, 0], [100.0, 40, 1]], dtype=torch.float64)
    grid = grid_around(points, 0.01)
    assert grid.n_vertices <= 200**3
    assert grid.contains(points, 6)
    assert grid_around(points, 5.0).cell == 5.0


def test_the_spacing_is_that_of_a_square_lattice() -> None:
    lattice = torch.from_numpy(np.stack(np.meshgrid(range(40), range(40), [0.0]), axis=-1).reshape(-1, 3))
    assert typical_spacing(lattice) == pytest.approx(1.0, rel=0.15)
