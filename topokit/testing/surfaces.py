"""Analytic surfaces: uniformly distributed points with exact normals and curvatures."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class AnalyticSamples:
    """Points of a surface with everything about them known exactly (float64).

    Attributes:
        points: (N, 3), uniformly distributed by area.
        normals: (N, 3), unit, outward.
        gaussian, mean: K and H, (N,); H is positive where the surface bends towards its inside.
        area: the whole surface's area.
        euler: its Euler characteristic.
    """

    points: Tensor
    normals: Tensor
    gaussian: Tensor
    mean: Tensor
    area: float
    euler: int


def sphere_samples(n_points: int, radius: float = 1.0, generator: torch.Generator | None = None) -> AnalyticSamples:
    """Independent uniform samples of a sphere: K = 1/r², H = 1/r."""
    directions = _directions(n_points, generator)
    ones = torch.ones(n_points, dtype=torch.float64)
    return AnalyticSamples(radius * directions, directions, ones / radius**2, ones / radius, 4 * math.pi * radius**2, 2)


def ellipsoid_samples(
    n_points: int, axes: tuple[float, float, float] = (1.0, 0.8, 0.6), generator: torch.Generator | None = None
) -> AnalyticSamples:
    """Independent uniform samples of x²/a² + y²/b² + z²/c² = 1 (by rejection from the mapped sphere).

    K = 1 / (a²b²c² q²) and H = (a² + b² + c² − |p|²) / (2 a²b²c² q^{3/2}) with q = x²/a⁴ + y²/b⁴ + z²/c⁴; the sign of
    H is the opposite of the paper's.
    """
    generator = generator or torch.Generator().manual_seed(0)
    scale = torch.tensor(axes, dtype=torch.float64)
    kept = torch.empty(0, 3, dtype=torch.float64)
    while len(kept) < n_points:
        directions = _directions(2 * n_points, generator)
        stretch = (directions / scale).norm(dim=1) * scale.min()  # proportional to the area element, at most 1
        chosen = torch.rand(len(directions), generator=generator, dtype=torch.float64) < stretch
        kept = torch.cat((kept, directions[chosen] * scale))
    points = kept[:n_points]
    q = (points / scale.square()).square().sum(1)
    product = float(scale.prod()) ** 2
    normals = points / scale.square() / q.sqrt()[:, None]
    mean = (scale.square().sum() - points.square().sum(1)) / (2 * product * q**1.5)
    return AnalyticSamples(points, normals, 1 / (product * q**2), mean, _ellipsoid_area(axes), 2)


def torus_samples(
    n_points: int, major: float = 1.0, minor: float = 0.4, generator: torch.Generator | None = None
) -> AnalyticSamples:
    """Independent uniform samples of a torus around the z axis (by rejection in the tube angle u).

    K = cos u / (r (R + r cos u)) and H = (1/r + cos u / (R + r cos u)) / 2; the paper prints cos v for cos u.
    """
    generator = generator or torch.Generator().manual_seed(0)
    tube = torch.empty(0, dtype=torch.float64)
    while len(tube) < n_points:
        angle, chance = torch.rand(2, 2 * n_points, generator=generator, dtype=torch.float64)
        angle = 2 * math.pi * angle
        tube = torch.cat((tube, angle[chance * (major + minor) < major + minor * angle.cos()]))
    tube = tube[:n_points]
    around = 2 * math.pi * torch.rand(n_points, generator=generator, dtype=torch.float64)
    distance = major + minor * tube.cos()
    points = torch.stack((distance * around.cos(), distance * around.sin(), minor * tube.sin()), dim=1)
    normals = torch.stack((tube.cos() * around.cos(), tube.cos() * around.sin(), tube.sin()), dim=1)
    gaussian = tube.cos() / (minor * distance)
    mean = (1 / minor + tube.cos() / distance) / 2
    return AnalyticSamples(points, normals, gaussian, mean, 4 * math.pi**2 * major * minor, 0)


def _directions(n_points: int, generator: torch.Generator | None) -> Tensor:
    generator = generator or torch.Generator().manual_seed(0)
    normal = torch.randn(n_points, 3, generator=generator, dtype=torch.float64)
    return normal / normal.norm(dim=1, keepdim=True)


def _ellipsoid_area(axes: tuple[float, float, float]) -> float:
    """Area by quadrature over the sphere: midpoints in z and in the angle, exact to about 1e-8."""
    a, b, c = axes
    steps = 1000
    z = (torch.arange(steps, dtype=torch.float64) + 0.5) / steps * 2 - 1
    angle = (torch.arange(steps, dtype=torch.float64) + 0.5) / steps * 2 * math.pi
    ring = (1 - z.square())[:, None]
    element = ((angle.cos() / a).square() + (angle.sin() / b).square()) * ring + (z[:, None] / c).square()
    return float(element.sqrt().mean()) * 4 * math.pi * a * b * c
