"""Geometry of grids: where their vertices are, what they cover, and which fit around samples."""

from __future__ import annotations

import math

import pytest
import torch

from topokit.core.grid.grid import Grid, make_grid
from topokit.errors import InputError


def test_positions_run_through_the_vertices_in_c_order() -> None:
    grid = Grid((2, 3, 4), (1.0, 0.5, 0.25), (10.0, 20.0, 30.0))
    axes = [
        start + step * torch.arange(n, dtype=torch.float64)
        for n, step, start in zip(grid.shape, grid.spacing, grid.origin, strict=True)
    ]
    assert torch.equal(grid.positions(torch.arange(grid.n_vertices)), torch.cartesian_prod(*axes))


def test_a_covering_grid_has_nearly_cubic_cells_and_ends_at_the_corners() -> None:
    low, high = (-1.0, 0.0, 2.0), (1.0, 0.5, 2.1)
    grid = Grid.covering(low, high, 64)
    assert (grid.shape, grid.n_cells, grid.origin) == ((65, 17, 9), 64, low)
    assert grid.step == 2 / 64
    corners = grid.positions(torch.tensor([0, grid.n_vertices - 1]))
    torch.testing.assert_close(corners, torch.tensor([low, high], dtype=torch.float64))


def test_refined_grids_keep_every_vertex() -> None:
    grid = Grid((3, 4, 5), (1.0, 2.0, 0.5), (1.0, 2.0, 3.0))
    fine = grid.refined()
    assert (fine.shape, fine.spacing) == ((5, 7, 9), (0.5, 1.0, 0.25))
    every_other = fine.positions(torch.arange(fine.n_vertices)).reshape(5, 7, 9, 3)[::2, ::2, ::2]
    assert torch.equal(every_other.reshape(-1, 3), grid.positions(torch.arange(grid.n_vertices)))


def test_only_cubes_have_one_edge_length() -> None:
    assert Grid((2, 2, 2), (0.5, 0.5, 0.5)).cell == 0.5
    with pytest.raises(InputError, match="must be cubes"):
        _ = Grid((2, 2, 2), (0.5, 0.5, 0.6)).cell


def test_containment_with_a_margin() -> None:
    grid = Grid((5, 5, 5), (0.5, 1.0, 1.0), (10.0, 0.0, 0.0))
    points = torch.tensor([[10.6, 1.5, 2.0], [11.4, 2.5, 2.0]])
    assert grid.contains(points)
    assert grid.contains(points, 1)
    assert not grid.contains(points, 1.3)
    assert not grid.contains(torch.tensor([[12.1, 2.0, 2.0]]))


def test_grids_around_samples_are_padded_bounded_and_even() -> None:
    points = torch.tensor([[0.0, 0, 0], [4, 1, 0.5]], dtype=torch.float64)
    grid = make_grid(points, 0.01, maximum_vertices=64**3)
    assert grid.n_vertices <= 64**3
    for n in grid.shape:
        rest = n
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        assert (n % 2, rest) == (0, 1), "real Fourier transforms of this length are slow"
    low, high = grid.positions(torch.tensor([0, grid.n_vertices - 1]))
    assert (points.amin(0) - low).min() >= 0.11 * 4
    assert (high - points.amax(0)).min() >= 0.11 * 4


def test_the_cell_follows_the_spacing() -> None:
    points = torch.tensor([[0.0, 0, 0], [1, 1, 1]])
    assert make_grid(points, 0.02, 2.0).cell == pytest.approx(0.01)
    assert make_grid(points, 0.02, 1.0).cell == pytest.approx(0.02)
    assert make_grid(points, math.inf, minimum_length=100).cell == pytest.approx(1 / 70)


@pytest.mark.parametrize(
    ("points", "spacing", "said"),
    [
        (torch.zeros(5, 3), 0.1, "all in one place"),
        (torch.full((5, 3), torch.nan), 0.1, "not finite"),
        (torch.eye(3), 0.0, "positive spacing"),
        (torch.zeros(0, 3), 0.1, "0 points"),
    ],
)
def test_unusable_samples_are_refused(points: torch.Tensor, spacing: float, said: str) -> None:
    with pytest.raises(InputError, match=said):
        make_grid(points, spacing)
