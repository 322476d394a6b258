"""Join the two parts of a goblet in an occupancy network whose data miss a piece of the stem.

    python examples/join_parts.py [PICTURE]

The data term is the usual cross-entropy of labeled points, including those in the gap, which are wrongly labeled empty.
τ has its default: half the logits' typical change over a cell. Expect two surfaces of genus 0 before and one after.
Takes about 15 seconds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from _judge import describe_surfaces
from _picture import save_pair
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

import topokit as tk


def goblet(points: Tensor) -> Tensor:
    """Whether points (N, 3) are inside: a foot, a stem with a piece missing, and a bowl around the z axis."""
    radius, z = points[:, :2].norm(dim=1), points[:, 2]
    foot = (radius < 0.5) & ((z + 0.75).abs() < 0.08)
    stem = (radius < 0.15) & ((z + 0.4).abs() < 0.4) & ((z + 0.42).abs() > 0.1)
    from_center = torch.hypot(radius, z - 0.4)
    bowl = (from_center < 0.55) & ((from_center > 0.37) | (z < 0.05)) & (z < 0.6)
    return foot | stem | bowl


class Occupancy(nn.Module):
    """A small network with positional encoding: (N, 3) -> logits (N,)."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("waves", torch.pi / 2 * torch.tensor([1.0, 2.0, 4.0]))
        self.layers = nn.Sequential(nn.Linear(21, 64), nn.GELU(), nn.Linear(64, 64), nn.GELU(), nn.Linear(64, 1))

    def forward(self, points: Tensor) -> Tensor:
        angles = (points[:, :, None] * self.waves).flatten(1)
        return self.layers(torch.cat((points, angles.sin(), angles.cos()), dim=1))[:, 0]


def main() -> None:
    parser = argparse.ArgumentParser(description="Join the parts of a goblet in an occupancy network.")
    parser.add_argument("picture", nargs="?", type=Path, default=Path("join_parts.png"))
    picture = parser.parse_args().picture
    torch.set_num_threads(1)  # faster for small tensors, and the same numbers on every machine
    torch.manual_seed(1)
    net = Occupancy()
    points = 2 * torch.rand(60_000, 3) - 1
    labels = goblet(points).float()
    axis = torch.linspace(-1, 1, 64)
    fine_points = torch.cartesian_prod(axis, axis, axis)

    def data_term(batch: Tensor | slice) -> Tensor:
        return binary_cross_entropy_with_logits(net(points[batch]), labels[batch])

    @torch.no_grad()
    def fine_field_and_data_term() -> tuple[Tensor, float]:
        """The logits on a finer grid than that of the loss, and the data term of all points."""
        return net(fine_points).reshape(64, 64, 64), float(data_term(slice(None)))

    optimizer = torch.optim.Adam(net.parameters(), lr=5e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, 1000)
    for _ in range(1000):
        optimizer.zero_grad()
        data_term(torch.randint(len(points), (4096,))).backward()
        optimizer.step()
        schedule.step()
    before, fit_before = fine_field_and_data_term()
    print(f"before: {describe_surfaces(before)}; data term {fit_before:.2e}")

    shape = tk.from_occupancy(net, logits=True, bounds=((-1, -1, -1), (1, 1, 1)), field_resolution=32)
    loss = tk.TopologyLoss(genus=0, change="add")
    monitor = tk.TopologyMonitor(loss, every=10, patience=15)
    optimizer = torch.optim.Adam(net.parameters(), lr=1e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, 300)
    for step in range(300):
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
    save_pair(picture, before, after, eye=(1.0, -1.6, 0.9))


if __name__ == "__main__":
    main()
