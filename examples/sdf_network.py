"""Train a signed distance network on a torus, report its topology, and differentiate it with respect to the weights.

python examples/sdf_network.py
"""

from __future__ import annotations

import time

import torch
from torch import Tensor, nn

import topokit as tk


def torus_distance(points: Tensor, major: float = 0.6, minor: float = 0.25) -> Tensor:
    """Signed distance (N,) of points (N, 3) to a torus around the z axis, negative inside."""
    return torch.hypot(points[:, :2].norm(dim=1) - major, points[:, 2]) - minor


def train(steps: int = 400) -> nn.Module:
    """A small network, trained on the torus from scratch."""
    torch.manual_seed(0)
    net = nn.Sequential(nn.Linear(3, 64), nn.Softplus(20), nn.Linear(64, 64), nn.Softplus(20), nn.Linear(64, 1))
    optimizer = torch.optim.Adam(net.parameters(), 3e-3)
    for _ in range(steps):
        points = 2 * torch.rand(2048, 3) - 1
        loss = (net(points)[:, 0] - torus_distance(points)).abs().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return net


def main() -> None:
    """Train, report, and differentiate."""
    started = time.perf_counter()
    net = train()
    print(f"trained in {time.perf_counter() - started:.1f} s")

    shape = tk.from_sdf(net, resolution=256)
    print(shape.report())

    print(f"\nGauss–Bonnet on {shape.samples.n_points} samples: {shape.gauss_bonnet().item():+.3f}")
    smoothed = shape.smoothed_euler()
    print(f"χ averaged over levels near 0:     {smoothed.item():+.3f}")

    shape.smoothed_euler(0.1).backward()
    largest = max(float(weight.grad.abs().max()) for weight in net.parameters() if weight.grad is not None)
    print(f"largest |dχ_τ/dweight| at τ = 0.1:  {largest:.3g}")


if __name__ == "__main__":
    main()
