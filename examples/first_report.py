"""The topology and curvature of a mesh and of a point cloud that this script makes itself.

python examples/first_report.py
"""

from __future__ import annotations

import math

import topokit as tk
from topokit.testing import genus_mesh, torus_samples


def main() -> None:
    mesh = tk.from_mesh(*genus_mesh(3))
    report = mesh.report(details=True)
    print(report)
    print(f"  χ from curvature: {report.estimate:.3f}; after self-optimization: {report.refined:.3f}\n")

    points = torus_samples(10_000).points.requires_grad_()
    cloud = tk.from_points(points)
    print(cloud.report())
    curvature = cloud.oriented().curvature()
    smallest, largest = curvature.gaussian.min(), curvature.gaussian.max()
    print(f"  Gaussian curvature from {smallest:.2f} to {largest:.2f} (exact: {-1 / 0.24:.2f} to {1 / 0.56:.2f})")
    print(f"  area {curvature.area.sum():.3f} (exact: {1.6 * math.pi**2:.3f})\n")

    estimate, refined = cloud.gauss_bonnet(), cloud.refined_euler()
    print(f"χ from curvature: {estimate:.3f}; after self-optimization: {refined:.3f}")
    estimate.backward()
    assert points.grad is not None
    print(f"mean length of the estimate's gradient at the points: {points.grad.norm(dim=1).mean():.2e}")


if __name__ == "__main__":
    main()
