"""The surfaces of the paper's Table I, sampled uniformly in two angles or by area, with noise."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from topokit.testing import AnalyticSamples, ellipsoid_samples, sphere_samples, torus_samples

Maker = Callable[[int, torch.Generator], AnalyticSamples]
AXES = (1.0, math.sqrt(2.0), 2.0)
FEW = 20_000  # points beyond which only k = 30 is tried, and what takes minutes has one draw


@dataclass(frozen=True)
class Column:
    """One column of Table I.

    Attributes:
        text: what it is.
        n_points: number of samples.
        by_angle, by_area: make samples uniform in both angles, which is what the paper's numbers imply, or by area.
        noise: standard deviation, in units of length.
        noise_share: the same as a share of the longest side, added to `noise`.
        parameters: angles (N, 2) of points; a mesh over them is the best one that there is.
    """

    text: str
    n_points: int
    by_angle: Maker
    by_area: Maker
    parameters: Callable[[Tensor], Tensor]
    noise: float = 0.0
    noise_share: float = 0.0

    def samples(self, seed: int, by_area: bool = False, share: float = 1.0) -> tuple[AnalyticSamples, Tensor]:
        """The surface at N random points, and those points with noise."""
        generator = torch.Generator().manual_seed(seed)
        known = (self.by_area if by_area else self.by_angle)(round(share * self.n_points), generator)
        side = float((known.points.amax(0) - known.points.amin(0)).max())
        sigma = self.noise + self.noise_share * side
        return known, known.points + sigma * torch.randn(known.points.shape, generator=generator, dtype=torch.float64)


def _angles(n: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    return tuple(2 * math.pi * torch.rand(2, n, generator=generator, dtype=torch.float64))  # type: ignore[return-value]


def ellipsoid_by_angle(axes: tuple[float, float, float]) -> Maker:
    """An ellipsoid at longitudes and colatitudes that are uniform in [0, 2π) and [0, π)."""

    def make(n: int, generator: torch.Generator) -> AnalyticSamples:
        longitude, colatitude = _angles(n, generator)
        colatitude = colatitude / 2
        scale = torch.tensor(axes, dtype=torch.float64)
        ring = colatitude.sin()
        points = scale * torch.stack((ring * longitude.cos(), ring * longitude.sin(), colatitude.cos()), dim=1)
        squared = (points / scale.square()).square().sum(1)
        product = float(scale.prod()) ** 2
        mean = (scale.square().sum() - points.square().sum(1)) / (2 * product * squared**1.5)
        normals = points / scale.square() / squared.sqrt()[:, None]
        area = ellipsoid_samples(1, axes).area
        return AnalyticSamples(points, normals, 1 / (product * squared.square()), mean, area, 2)

    return make


def torus_by_angle(major: float, minor: float) -> Maker:
    """A torus at angles that are uniform in [0, 2π)."""

    def make(n: int, generator: torch.Generator) -> AnalyticSamples:
        tube, around = _angles(n, generator)
        distance = major + minor * tube.cos()
        normals = torch.stack((tube.cos() * around.cos(), tube.cos() * around.sin(), tube.sin()), dim=1)
        center = torch.stack((around.cos(), around.sin(), torch.zeros(n)), dim=1)
        mean = (1 / minor + tube.cos() / distance) / 2
        area = 4 * math.pi**2 * major * minor
        points = major * center + minor * normals
        return AnalyticSamples(points, normals, tube.cos() / (minor * distance), mean, area, 0)

    return make


def torus_angles(major: float) -> Callable[[Tensor], Tensor]:
    """Angles around the axis and around the tube of points (N, 3)."""

    def angles(points: Tensor) -> Tensor:
        x, y, z = points.unbind(1)
        return torch.stack((torch.atan2(y, x), torch.atan2(z, torch.hypot(x, y) - major)), dim=1)

    return angles


def _ellipsoid(text: str, n: int, axes: tuple[float, float, float]) -> Column:
    scale = torch.tensor(axes, dtype=torch.float64)
    by_area: Maker = lambda m, generator: ellipsoid_samples(m, axes, generator)  # noqa: E731
    return Column(text, n, ellipsoid_by_angle(axes), by_area, lambda points: points / scale)


def _torus(text: str, n: int, major: float, minor: float) -> Column:
    by_area: Maker = lambda m, generator: torus_samples(m, major, minor, generator)  # noqa: E731
    return Column(text, n, torus_by_angle(major, minor), by_area, torus_angles(major))


_B, _E = _ellipsoid("ellipsoid 1, √2, 2", 10_000, AXES), _torus("torus R 5, r 3", 70_000, 5, 3)
COLUMNS: dict[str, Column] = {
    "A": _ellipsoid("sphere r = 1", 2_000, (1.0, 1.0, 1.0)),
    "B": _B,
    "C": replace(_B, text="B with noise σ = 0.025", noise=0.025),
    "D": _torus("torus R 5, r 1", 10_000, 5, 1),
    "E": _E,
    "F": replace(_E, text="E with noise σ = 0.025", noise=0.025),
    "F′": replace(_E, text="E with noise of 2.5 % of the longest side", noise_share=0.025),
}
STUDY: dict[str, Maker] = {
    "sphere": lambda n, generator: sphere_samples(n, generator=generator),
    "ellipsoid": lambda n, generator: ellipsoid_samples(n, generator=generator),
    "torus": lambda n, generator: torus_samples(n, generator=generator),
}


def noisy(known: AnalyticSamples, share: float, seed: int) -> Tensor:
    """The points with Gaussian noise of a share of the longest side."""
    side = float((known.points.amax(0) - known.points.amin(0)).max())
    generator = torch.Generator().manual_seed(1000 + seed)
    return known.points + share * side * torch.randn(known.points.shape, generator=generator, dtype=torch.float64)
