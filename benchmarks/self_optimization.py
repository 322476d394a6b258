"""The effect of self-optimization on normals and curvature where both are known.

Writes the table of docs/self-optimization.md:

python benchmarks/self_optimization.py
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from topokit.core.local.curvature import CurvatureSettings, surface_curvature
from topokit.core.local.self_optimization import self_optimize
from topokit.core.samples import SurfaceSamples
from topokit.testing import AnalyticSamples, ellipsoid_samples, sphere_samples, torus_samples

SHAPES: dict[str, Callable[..., AnalyticSamples]] = {
    "sphere": sphere_samples,
    "ellipsoid": ellipsoid_samples,
    "torus": torus_samples,
}
PAPER = CurvatureSettings(normal_method="pca")


def errors(samples: SurfaceSamples, known: AnalyticSamples, neighbors: Tensor) -> tuple[float, float]:
    """Mean angle to the true normals in degrees, and median error of K over the median of |K|."""
    local = surface_curvature(samples, PAPER, neighbors=neighbors)
    cosine = (local.normals * known.normals).sum(-1).abs().clamp(max=1)
    spread = float(known.gaussian.abs().median())
    curvature = float((local.gaussian - known.gaussian).abs().median()) / spread
    return math.degrees(float(cosine.acos().mean())), curvature


def main() -> None:
    print("| shape | noise | χ⁽⁰⁾ | rounded | χ⁽ᴷ⁾ | steps | turn | normal error | error of K |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name, make in SHAPES.items():
        for noise in (0.0, 0.005, 0.01):
            generator = torch.Generator().manual_seed(0)
            known = make(10_000, generator=generator)
            size = float((known.points.amax(0) - known.points.amin(0)).max())
            jitter = torch.randn(known.points.shape, generator=generator, dtype=torch.float64)
            start = SurfaceSamples(known.points + noise * size * jitter)
            local = surface_curvature(start, PAPER)
            before = errors(start, known, local.neighbors)
            found = self_optimize(start, float(known.euler), settings=PAPER, neighbors=local.neighbors)
            after = errors(found.samples, known, local.neighbors)
            first = float(found.history[0])
            print(
                f"| {name} | {noise:.1%} | {first:.2f} | {2 * round(first / 2)} (truth {known.euler}) "
                f"| {float(found.history[-1]):.4f} | {found.steps} | {math.degrees(found.mean_turn):.2f}° "
                f"| {before[0]:.2f}° → {after[0]:.2f}° | {before[1]:.1%} → {after[1]:.1%} |"
            )


if __name__ == "__main__":
    main()
