"""Twenty kinds of point clouds that neighbor searches get wrong or slow: clusters, outliers, ties, lines, planes."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Generator, Tensor

DOUBLE = torch.float64


def _normal(n: int, random: Generator) -> Tensor:
    return torch.randn(n, 3, generator=random, dtype=DOUBLE)


def _uniform(n: int, random: Generator) -> Tensor:
    return torch.rand(n, 3, generator=random, dtype=DOUBLE)


def _sphere(n: int, random: Generator) -> Tensor:
    return torch.nn.functional.normalize(_normal(n, random), dim=1)


def _integers(n: int, random: Generator, side: int) -> Tensor:
    return torch.randint(0, side, (n, 3), generator=random).to(DOUBLE)


def _lattice(n: int) -> Tensor:
    side = round(n ** (1 / 3)) + 1
    return torch.cartesian_prod(*[torch.arange(side, dtype=DOUBLE)] * 3)[:n]


def _clusters(n: int, random: Generator, spread: float) -> Tensor:
    centers = _uniform(7, random)
    return centers[torch.randint(0, 7, (n,), generator=random)] + spread * _normal(n, random)


def _with_rows(points: Tensor, rows: Tensor) -> Tensor:
    """The points with some rows in place of the first ones."""
    return torch.cat((rows, points[len(rows) :]))


CLOUDS: dict[str, Callable[[int, Generator], Tensor]] = {
    "uniform": _uniform,
    "sphere": _sphere,
    "sphere and its center": lambda n, random: _with_rows(_sphere(n, random), torch.zeros(1, 3, dtype=DOUBLE)),
    "one outlier": lambda n, random: _with_rows(_sphere(n, random), torch.full((1, 3), 1e6, dtype=DOUBLE)),
    "outliers": lambda n, random: _with_rows(_sphere(n, random), 50 * _normal(n // 10, random)),
    "heavy tails": lambda n, random: _normal(n, random) / _normal(n, random)[:, :1],
    "clusters": lambda n, random: _clusters(n, random, 1e-3),
    "points that are clusters": lambda n, random: _clusters(n, random, 1e-12),
    "clusters within clusters": lambda n, random: torch.exp(-9 * _uniform(n, random)[:, :1]) * _normal(n, random),
    "lattice": lambda n, random: _lattice(n),
    "shuffled lattice": lambda n, random: _lattice(n)[torch.randperm(n, generator=random)],
    "few places": lambda n, random: _integers(n, random, 3),
    "two places": lambda n, random: _integers(n, random, 2) * torch.tensor([1.0, 0, 0], dtype=DOUBLE),
    "one place": lambda n, random: torch.ones(n, 3, dtype=DOUBLE),
    "half in one place": lambda n, random: _with_rows(_sphere(n, random), torch.ones(n // 2, 3, dtype=DOUBLE)),
    "plane": lambda n, random: _uniform(n, random) * torch.tensor([1.0, 1, 0], dtype=DOUBLE),
    "grid in a plane": lambda n, random: _integers(n, random, 20) * torch.tensor([1.0, 1, 0], dtype=DOUBLE),
    "tilted line": lambda n, random: _uniform(n, random)[:, :1] * torch.tensor([1.0, 2, 3], dtype=DOUBLE),
    "even line": lambda n, random: torch.arange(n, dtype=DOUBLE)[:, None] * torch.tensor([0.0, 1, 0], dtype=DOUBLE),
    "two parallel sheets": lambda n, random: (
        _uniform(n, random).mul(torch.tensor([1.0, 1, 2], dtype=DOUBLE)).floor()
        * torch.tensor([0.0, 0, 1e-9], dtype=DOUBLE)
        + _uniform(n, random) * torch.tensor([1.0, 1, 0], dtype=DOUBLE)
    ),
}
