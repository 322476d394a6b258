"""Close the hole of a torus in a neural SDF, while the data term holds the rest of the shape.

    python examples/close_a_hole.py [PICTURE]

Expect one surface of genus 1 before and one of genus 0 after: a thin disk grows across the hole. The monitor waits
until the topology has held for 200 steps, in which the data term recovers from the change. Takes about 15 seconds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from _judge import describe_surfaces
from _picture import save_pair
from torch import Tensor, nn

import topokit as tk


def torus_distance(points: Tensor, major: float = 0.5, minor: float = 0.32) -> Tensor:
    """Signed distance (N,) of points (N, 3) to a torus around the z axis, negative inside."""
    return torch.hypot(points[:, :2].norm(dim=1) - major, points[:, 2]) - minor


class SignedDistance(nn.Module):
    """A small network with positional encoding: (N, 3) -> (N,)."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("waves", torch.pi / 2 * torch.tensor([1.0, 2.0]))
        self.layers = nn.Sequential(
            nn.Linear(15, 64), nn.Softplus(30), nn.Linear(64, 64), nn.Softplus(30), nn.Linear(64, 1)
        )

    def forward(self, points: Tensor) -> Tensor:
        angles = (points[:, :, None] * self.waves).flatten(1)
        return self.layers(torch.cat((points, angles.sin(), angles.cos()), dim=1))[:, 0]


def main() -> None:
    parser = argparse.ArgumentParser(description="Close the hole of a torus that a network has learned.")
    parser.add_argument("picture", nargs="?", type=Path, default=Path("close_a_hole.png"))
    picture = parser.parse_args().picture
    torch.set_num_threads(1)  # faster for small tensors, and the same numbers on every machine
    torch.manual_seed(0)
    net = SignedDistance()
    points = 2 * torch.rand(60_000, 3) - 1
    distances = torus_distance(points).clamp(-0.2, 0.2) + 0.02 * torch.randn(len(points))
    axis = torch.linspace(-1, 1, 64)
    fine_points = torch.cartesian_prod(axis, axis, axis)

    def data_term(batch: Tensor | slice) -> Tensor:
        return (net(points[batch]) - distances[batch]).square().mean()

    @torch.no_grad()
    def fine_field_and_data_term() -> tuple[Tensor, float]:
        """The field, positive inside, on a finer grid than that of the loss, and the data term of all points."""
        return -net(fine_points).reshape(64, 64, 64), float(data_term(slice(None)))

    optimizer = torch.optim.Adam(net.parameters(), lr=3e-3)
    for _ in range(600):
        optimizer.zero_grad()
        data_term(torch.randint(len(points), (4096,))).backward()
        optimizer.step()
    before, fit_before = fine_field_and_data_term()
    print(f"before: {describe_surfaces(before)}; data term {fit_before:.2e}")

    shape = tk.from_sdf(net, bounds=((-1, -1, -1), (1, 1, 1)), field_resolution=32)
    loss = tk.TopologyLoss(genus=0, change="add")
    monitor = tk.TopologyMonitor(loss, every=10, patience=20)
    optimizer = torch.optim.Adam(net.parameters(), lr=1e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, 400)
    for step in range(400):
        if monitor(step, shape):
            break
        optimizer.zero_grad()
        (data_term(torch.randint(len(points), (4096,))) + loss(shape, keys="net")).backward()
        optimizer.step()
        schedule.step()

    after, fit_after = fine_field_and_data_term()
    print(
        f"after {step} steps: {describe_surfaces(after)}; data term {fit_after:.2e}, {fit_after / fit_before - 1:+.1%}"
    )
    save_pair(picture, before, after)


if __name__ == "__main__":
    main()
