"""Close the gap in the scan of a ring by moving its points.

    python examples/points_close_gap.py [PICTURE]

The parameters are the points and their normals. The loss uses their winding-number field, which is 0 outside, 1 inside
and ½ on the surface. The data term keeps each point near its measured position and its neighbors.
Expect one surface of genus 0 before and one of genus 1 after, both counted on a reconstruction that does not use
topokit. Takes about 10 seconds.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import torch
from _judge import describe_surfaces
from _picture import save_pair
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

import topokit as tk

SIZE, SIDE = 48, 2.4  # of the grid of the reconstruction, around the origin


def scan(n_around: int = 60, n_across: int = 24, gap: float = 0.9) -> tuple[Tensor, Tensor]:
    """Points and outward normals (N, 3) of a torus around the z axis; `gap` radians of it are missing."""
    around = torch.linspace(gap / 2, 2 * math.pi - gap / 2, n_around)[:, None].expand(-1, n_across)
    across = 2 * math.pi * (torch.arange(n_across) + torch.arange(n_around)[:, None] % 2 / 2) / n_across
    outwards = torch.stack((around.cos(), around.sin(), torch.zeros_like(around)), dim=-1)
    upwards = torch.tensor([0.0, 0.0, 1.0])
    normals = (across.cos()[..., None] * outwards + across.sin()[..., None] * upwards).reshape(-1, 3)
    points = (0.7 * outwards).reshape(-1, 3) + 0.25 * normals
    return points + 0.004 * torch.randn(points.shape, generator=torch.Generator().manual_seed(0)), normals


def reconstruction(points: Tensor, normals: Tensor) -> NDArray[np.float64]:
    """Winding number minus ½ on a grid (SIZE, SIZE, SIZE), by direct summation over the points.

    A point stands for a disk of area π r² / 8, r being the distance to its eighth neighbor; its dipole is smoothed over
    r / 2.
    """
    at, outward = points.detach().double().numpy(), normals.detach().double().numpy()
    reach = cKDTree(at).query(at, 9)[0][:, -1]
    dipoles = (np.pi * reach**2 / 8 / np.linalg.norm(outward, axis=1))[:, None] * outward
    axis = np.linspace(-SIDE / 2, SIDE / 2, SIZE)
    layers = []
    for x in axis:
        places = np.stack(np.meshgrid(x, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
        squared = (places**2).sum(1)[:, None] - 2 * places @ at.T + (at**2).sum(1) + reach**2 / 4
        layers.append((((dipoles * at).sum(1) - places @ dipoles.T) / squared**1.5).sum(1) / (4 * np.pi))
    return np.stack(layers).reshape(SIZE, SIZE, SIZE) - 0.5


def main() -> None:
    parser = argparse.ArgumentParser(description="Close the gap in the scan of a ring by moving its points.")
    parser.add_argument("picture", nargs="?", type=Path, default=Path("points_close_gap.png"))
    picture = parser.parse_args().picture
    torch.set_num_threads(1)  # faster for small tensors, and the same numbers on every machine
    measured, measured_normals = scan()
    distance, neighbors = (torch.from_numpy(found[:, 1:]) for found in cKDTree(measured).query(measured, 9))
    spacing = float(distance[:, 0].mean())
    points, normals = measured.clone().requires_grad_(), measured_normals.clone().requires_grad_()
    before = reconstruction(points, normals)
    print(f"before: {describe_surfaces(before)}")

    def data_term() -> Tensor:
        """Mean squares of: displacements, their differences between neighbors, and changes of normals."""
        moved, turned = (points - measured) / spacing, normals - measured_normals
        strained = moved[:, None] - moved[neighbors]
        return 0.3 * moved.square().mean() + 3 * strained.square().mean() + 10 * turned.square().mean()

    loss = tk.TopologyLoss(genus=1, change="add", resolution=40)
    monitor = tk.TopologyMonitor(loss, every=10, patience=10)
    optimizer = torch.optim.Adam([points, normals], lr=5e-3)
    for step in range(300):
        shape = tk.from_points(points, normals)
        if monitor(step, shape):
            break
        optimizer.zero_grad()
        (data_term() + loss(shape, keys="scan")).backward()
        optimizer.step()

    after, moved = reconstruction(points, normals), (points - measured).detach().norm(dim=1) / spacing
    print(f"after {step} steps: {describe_surfaces(after)}; data term {data_term().item():.3f}, from 0: the points")
    print(f"  moved by {moved.mean():.2f} spacings on average, 95 % of them by less than {moved.quantile(0.95):.2f}")
    dots = [(where.detach().numpy() / SIDE + 0.5) * (SIZE - 1) for where in (measured, points)]
    save_pair(picture, before, after, zoom=1.25, dots=(dots[0], dots[1]))


if __name__ == "__main__":
    main()
