"""Gaussians that absorb light, summed on a grid."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from topokit.core.grid.grid import Grid
from topokit.core.opacity.extinction import REACH, extinction


def drawn(count: int, seed: int = 0) -> tuple[Tensor, Tensor, Tensor]:
    """Means, covariances and integrals of random Gaussians within the grid."""
    generator = torch.Generator().manual_seed(seed)
    means = torch.rand(count, 3, generator=generator, dtype=torch.float64) - 0.5
    axes = 0.2 * torch.randn(count, 3, 3, generator=generator, dtype=torch.float64)
    covariances = axes @ axes.mT + 0.03 * torch.eye(3, dtype=torch.float64)
    return means, covariances, torch.rand(count, generator=generator, dtype=torch.float64)


GRID = Grid((24, 22, 20), (0.16, 0.16, 0.16), (-1.8, -1.7, -1.6))


def test_it_is_the_sum_of_densities_cut_off_at_three_standard_deviations() -> None:
    means, covariances, integrals = drawn(7)
    places = GRID.positions(torch.arange(GRID.n_vertices))
    away = places[:, None] - means
    powers = torch.einsum("vgi,gij,vgj->vg", away, torch.linalg.inv(covariances), away)
    heights = integrals / ((2 * math.pi) ** 3 * torch.linalg.det(covariances)).sqrt()
    expected = (torch.where(powers < REACH**2, torch.exp(-powers / 2), 0.0) * heights).sum(1)
    torch.testing.assert_close(extinction(means, covariances, integrals, GRID).reshape(-1), expected)


def test_the_depth_along_a_ray_through_a_disc_does_not_depend_on_its_thickness() -> None:
    for thickness in (0.1, 0.2):
        covariance = torch.diag(torch.tensor([0.09, 0.09, thickness**2], dtype=torch.float64))[None]
        integral = torch.tensor([0.7 * 2 * math.pi * 0.09], dtype=torch.float64)
        grid = Grid((3, 3, 201), (0.01, 0.01, 0.01), (-0.01, -0.01, -1.0))
        found = extinction(torch.zeros(1, 3, dtype=torch.float64), covariance, integral, grid)
        assert abs(float(found[1, 1].sum()) * 0.01 / 0.7 - 1) < 0.005  # what is cut off is 0.3 %


def test_it_is_differentiable_in_all_that_a_gaussian_has() -> None:
    means, covariances, integrals = (part.requires_grad_() for part in drawn(4, seed=1))
    weights = torch.randn(GRID.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64)

    def total(means: Tensor, covariances: Tensor, integrals: Tensor) -> Tensor:
        return (extinction(means, (covariances + covariances.mT) / 2, integrals, GRID) * weights).sum()

    assert torch.autograd.gradcheck(total, (means, covariances, integrals), eps=1e-7, atol=1e-4)


def test_what_lies_outside_the_grid_adds_nothing() -> None:
    means, covariances, integrals = drawn(3)
    assert float(extinction(means + 100, covariances, integrals, GRID).abs().max()) == 0
    assert np.isfinite(extinction(means, covariances, 0 * integrals, GRID).numpy()).all()
