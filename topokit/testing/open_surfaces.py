"""Analytic surfaces with boundary: uniformly distributed points with exact normals, curvatures and χ."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from topokit.testing.surfaces import AnalyticSamples, sphere_samples


def hemisphere_samples(n_points: int, radius: float = 1.0, generator: torch.Generator | None = None) -> AnalyticSamples:
    """Independent uniform samples of the upper half of a sphere: χ = 1, one boundary circle on the plane z = 0."""
    sphere = sphere_samples(n_points, radius, generator)
    up = torch.where(sphere.points[:, 2:] < 0, sphere.points.new_tensor((1, 1, -1)), 1)
    return AnalyticSamples(sphere.points * up, sphere.normals * up, sphere.gaussian, sphere.mean, sphere.area / 2, 1)


def cylinder_samples(
    n_points: int, radius: float = 1.0, height: float = 2.0, generator: torch.Generator | None = None
) -> AnalyticSamples:
    """Independent uniform samples of the side of a cylinder around the z axis: χ = 0, two boundary circles."""
    share = _uniform(n_points, 2, generator)
    angle = 2 * math.pi * share[:, 0]
    normals = torch.stack((angle.cos(), angle.sin(), torch.zeros_like(angle)), dim=1)
    points = radius * normals
    points[:, 2] = height * share[:, 1]
    zeros = torch.zeros_like(angle)
    return AnalyticSamples(points, normals, zeros, zeros + 0.5 / radius, 2 * math.pi * radius * height, 0)


def plate_samples(
    n_points: int, side: float = 2.0, hole: float = 0.5, generator: torch.Generator | None = None
) -> AnalyticSamples:
    """Independent uniform samples of a flat square around the origin with a round hole.

    Args:
        n_points: number of points.
        side: length of its sides.
        hole: radius of the hole, less than side / 2; 0 for none.
        generator: of the random numbers.

    Returns:
        Samples on the plane z = 0 with χ = 0 and two boundary curves, or χ = 1 and one without a hole.
    """
    generator = generator or torch.Generator().manual_seed(0)
    kept = torch.empty(0, 2, dtype=torch.float64)
    while len(kept) < n_points:
        flat = side * (_uniform(2 * n_points, 2, generator) - 0.5)
        kept = torch.cat((kept, flat[flat.norm(dim=1) >= hole]))
    points = torch.nn.functional.pad(kept[:n_points], (0, 1))
    zeros = torch.zeros(n_points, dtype=torch.float64)
    up = points.new_tensor((0, 0, 1)).expand_as(points)
    return AnalyticSamples(points, up, zeros, zeros, side**2 - math.pi * hole**2, 0 if hole > 0 else 1)


def _uniform(n_points: int, dimensions: int, generator: torch.Generator | None) -> Tensor:
    generator = generator or torch.Generator().manual_seed(0)
    return torch.rand(n_points, dimensions, generator=generator, dtype=torch.float64)
