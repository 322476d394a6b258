"""The topology and curvature of a mesh and of a point cloud that this script makes itself.

python examples/first_report.py
"""

from __future__ import annotations

import math

import topokit as tk
from topokit.testing import genus_mesh, torus_samples


def main() -> None:
    mesh = tk.from_mesh(*genus_mesh(3))
    print(mesh.report(details=True))
    print(f"  estimated from curvature: χ ≈ {float(mesh.euler()):.3f}\n")

    points = torus_samples(10_000).points.requires_grad_()
    cloud = tk.from_points(points)
    print(cloud.report())
    curvature = cloud.oriented().curvature()
    smallest, largest = float(curvature.gaussian.min()), float(curvature.gaussian.max())
    print(f"  Gaussian curvature from {smallest:.2f} to {largest:.2f} (exact: {-1 / 0.24:.2f} to {1 / 0.56:.2f})")
    print(f"  area {float(curvature.area.sum()):.3f} (exact: {1.6 * math.pi**2:.3f})\n")

    estimate, refined = cloud.euler(), cloud.refined_euler()
    print(f"χ from curvature: {float(estimate):.3f}; after self-optimization: {float(refined):.3f}")
    estimate.backward()
    assert points.grad is not None
    print(f"mean length of the estimate's gradient at the points: {float(points.grad.norm(dim=1).mean()):.2e}")


if __name__ == "__main__":
    main()
