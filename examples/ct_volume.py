"""Topology and curvature of a synthetic CT scan: a noisy, porous ball with a closed hollow.

python examples/ct_volume.py
"""

from __future__ import annotations

import torch
from torch import Tensor

import topokit as tk


def scan(size: int = 96, noise: float = 0.1) -> Tensor:
    """Gray values (X, Y, Z) of a gyroid-like foam in a ball with a closed hollow, with noise; matter is bright."""
    axis = torch.linspace(-1, 1, size)
    x, y, z = torch.meshgrid(axis, axis, axis, indexing="ij")
    radius = (x.square() + y.square() + z.square()).sqrt()
    k = 9.0
    foam = (k * x).sin() * (k * y).cos() + (k * y).sin() * (k * z).cos() + (k * z).sin() * (k * x).cos()
    matter = torch.minimum(0.85 - radius, 0.12 * (0.9 - foam.abs()))
    shell = 0.05 - (radius - 0.4).abs()
    values = torch.maximum(torch.where(radius < 0.4, -1.0, matter), shell)
    generator = torch.Generator().manual_seed(0)
    return 0.5 + (8 * values).clamp(-0.5, 0.5) + noise * torch.randn(values.shape, generator=generator) / 4


def main() -> None:
    """Report the volume under both connectivities, list its largest surfaces, and compute its curvature."""
    volume = scan()
    spacing = (0.02, 0.02, 0.02)  # millimeters
    for connectivity in (26, 6):
        report = tk.from_voxels(volume, spacing=spacing, level=0.5, connectivity=connectivity).report()
        print(report)
        print("  largest surfaces:")
        for part in report.per_component[:3]:
            wall = "cavity wall" if part.depth and part.depth % 2 else "outer surface"
            print(f"    {wall}: χ {part.euler}, {part.genus} handles, {100 * part.area_share:.1f} % of the area")

    cut = tk.from_voxels(volume[:, :, :50], spacing=spacing, level=0.5)
    print(f"\nthe same, cut in two: χ = {cut.report().euler}")
    print("  " + next(reason for reason in cut.report().reasons if "border" in reason))

    mean = tk.from_voxels(volume, spacing=spacing, level=0.5).curvature().mean
    quartiles = mean.quantile(torch.tensor([0.25, 0.5, 0.75], dtype=mean.dtype)).tolist()
    print(f"\nmean curvature, quartiles: {', '.join(f'{value:.1f}' for value in quartiles)} per mm")


if __name__ == "__main__":
    main()
