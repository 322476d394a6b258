"""A zoo of points that are no surface, or hardly one, in numbers of any size."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from topokit.testing import sphere_samples

DOUBLE = torch.float64


def sphere(n_points: int) -> Tensor:
    return sphere_samples(n_points).points


def noise(n_points: int) -> Tensor:
    return torch.randn(n_points, 3, generator=torch.Generator().manual_seed(0), dtype=DOUBLE)


def duplicates(n_points: int) -> Tensor:
    """Some places twice, some three times."""
    third = sphere(n_points // 3)
    return torch.cat((third, third, third[: n_points // 6], sphere(n_points)[third.shape[0] :]))[:n_points]


def flat_grid(n_points: int) -> Tensor:
    ticks = torch.arange(round(n_points**0.5), dtype=DOUBLE)
    return torch.nn.functional.pad(torch.cartesian_prod(ticks, ticks), (0, 1))


def lattice(n_points: int) -> Tensor:
    ticks = torch.arange(round(n_points ** (1 / 3)), dtype=DOUBLE)
    return torch.cartesian_prod(ticks, ticks, ticks)


def with_island(n_points: int, value: float) -> Tensor:
    """A sphere whose cap is no number."""
    points = sphere(n_points)
    return torch.where(points[:, 2:] > 0.8, value, points)


ZOO: dict[str, Callable[[int], Tensor]] = {
    "sphere": sphere,
    "duplicates": duplicates,
    "one place": lambda n: torch.ones(n, 3, dtype=DOUBLE),
    "two places": lambda n: torch.tensor([[0.0] * 3, [1.0] * 3], dtype=DOUBLE).repeat_interleave(n // 2, 0),
    "line": lambda n: noise(n)[:, :1] * torch.tensor([1.0, 2.0, 3.0], dtype=DOUBLE),
    "plane": lambda n: noise(n) * torch.tensor([1.0, 1.0, 0.0], dtype=DOUBLE),
    "flat grid": flat_grid,
    "lattice": lattice,
    "blob": noise,
    "outlier": lambda n: torch.cat((sphere(n - 1), torch.tensor([[1e4, 0, 0]], dtype=DOUBLE))),
    "absurd outlier": lambda n: torch.cat((sphere(n - 1), torch.tensor([[0, 1e30, 0]], dtype=DOUBLE))),
    "NaN island": lambda n: with_island(n, torch.nan),
    "infinite island": lambda n: with_island(n, torch.inf),
    "far off": lambda n: sphere(n) + 1000,
    "as large as halves go": lambda n: sphere(n) * 6e4,
    "1e-6": lambda n: sphere(n) * 1e-6,
    "1e-30": lambda n: sphere(n) * 1e-30,
    "1e30": lambda n: sphere(n) * 1e30,
    "denormal": lambda n: sphere(n) * 1e-310,
    "mostly no numbers": lambda n: torch.where(sphere(n)[:, 2:] > -0.5, torch.nan, sphere(n)),
    "22 points": lambda n: sphere(22),
    "one point": lambda n: sphere(1),
    "none": lambda n: sphere(1)[:0],
}
