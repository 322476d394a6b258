"""Analytic surfaces, closed and with boundary: uniformly distributed points with exact normals, curvatures and χ."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

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


def shell_samples(
    n_points: int, radius: float = 1.0, thickness: float = 0.1, generator: torch.Generator | None = None
) -> AnalyticSamples:
    """Independent uniform samples of both sides of a hollow ball: χ = 4, a sphere and a cavity.

    The normals of the inner sphere point towards the center, out of the solid, so its H is negative.
    """
    inner_radius = radius - thickness
    inner_share = inner_radius**2 / (radius**2 + inner_radius**2)
    n_inner = round(n_points * inner_share)
    generator = generator or torch.Generator().manual_seed(0)
    outer = sphere_samples(n_points - n_inner, radius, generator)
    inner = sphere_samples(n_inner, inner_radius, generator)
    return union(outer, replace(inner, normals=-inner.normals, mean=-inner.mean))


def linked_tori_samples(
    n_points: int, major: float = 1.0, minor: float = 0.25, generator: torch.Generator | None = None
) -> AnalyticSamples:
    """Independent uniform samples of two tori linked like the rings of a chain: χ = 0, two components of genus 1."""
    generator = generator or torch.Generator().manual_seed(0)
    first = torus_samples(n_points - n_points // 2, major, minor, generator)
    second = torus_samples(n_points // 2, major, minor, generator)
    upright = [values[:, [0, 2, 1]] * values.new_tensor((1, -1, 1)) for values in (second.points, second.normals)]
    aside = first.points.new_tensor((major, 0, 0))
    return union(first, replace(second, points=upright[0] + aside, normals=upright[1]))


def union(*parts: AnalyticSamples) -> AnalyticSamples:
    """Several surfaces that do not meet as one; area and χ are the sums."""
    return AnalyticSamples(
        points=torch.cat([part.points for part in parts]),
        normals=torch.cat([part.normals for part in parts]),
        gaussian=torch.cat([part.gaussian for part in parts]),
        mean=torch.cat([part.mean for part in parts]),
        area=sum(part.area for part in parts),
        euler=sum(part.euler for part in parts),
    )


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
