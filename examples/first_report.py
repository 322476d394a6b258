"""Three questions to a mesh and a cloud that this script makes itself.

python examples/first_report.py
"""

from __future__ import annotations

import topokit as tk
from topokit.testing import genus_mesh, torus_samples


def main() -> None:
    mesh = tk.from_mesh(genus_mesh(3))
    print(mesh.report())
    print(f"  its differentiable estimate: {float(mesh.euler()):.3f}\n")

    points = torus_samples(10_000).points.requires_grad_()
    cloud = tk.from_points(points)
    print(cloud.report())

    curvature = cloud.curvature()
    smallest, largest = curvature.gaussian.min(), curvature.gaussian.max()
    print(f"  Gaussian curvature between {float(smallest):.2f} and {float(largest):.2f}")
    print(f"  area {float(curvature.area.sum()):.3f} (exactly {4 * 3.14159265**2 * 0.4:.3f})")

    cloud.euler().backward()
    assert points.grad is not None
    print(f"  the estimate's gradient reaches the points: mean length {float(points.grad.norm(dim=1).mean()):.2e}")


if __name__ == "__main__":
    main()
