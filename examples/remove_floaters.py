"""Remove the floaters from a volume that is reconstructed from three noisy projections.

    python examples/remove_floaters.py [PICTURE]

The parameters are the occupancies of a grid, as logits; the data term is the squared difference between its projections
and the images, plus smoothness. Expect a ring among ten floaters before and the ring alone after, with images that fit
about as well. Takes about 15 seconds.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import torch
from _judge import describe_surfaces
from _picture import save_pair
from torch import Tensor
from torch.nn.functional import affine_grid, avg_pool2d, grid_sample

import topokit as tk

SIZE, VIEWS = 40, 3


def ring() -> Tensor:
    """Occupancy (SIZE, SIZE, SIZE) of a tilted torus."""
    axis = torch.linspace(-1, 1, SIZE)
    x, y, z = torch.meshgrid(axis, axis, axis, indexing="ij")
    y, z = 0.8 * y - 0.6 * z, 0.6 * y + 0.8 * z
    return (30 * (0.22 - torch.hypot(torch.hypot(x, y) - 0.55, z))).sigmoid()


def directions() -> Tensor:
    """Rotations (VIEWS, 3, 4) for `affine_grid`, by equal angles about the x axis."""
    angles = torch.arange(VIEWS) * math.pi / VIEWS
    one, zero = torch.ones_like(angles), torch.zeros_like(angles)
    rows = (one, zero, zero, zero, zero, angles.cos(), -angles.sin(), zero, zero, angles.sin(), angles.cos(), zero)
    return torch.stack(rows, dim=1).reshape(VIEWS, 3, 4)


def main() -> None:
    parser = argparse.ArgumentParser(description="Remove the floaters of a reconstruction.")
    parser.add_argument("picture", nargs="?", type=Path, default=Path("remove_floaters.png"))
    picture = parser.parse_args().picture
    torch.set_num_threads(1)  # faster for small tensors, and the same numbers on every machine
    generator = torch.Generator().manual_seed(0)
    lines = affine_grid(directions(), [VIEWS, 1, SIZE, SIZE, SIZE], align_corners=True)

    def projections(occupancy: Tensor) -> Tensor:
        """Images (VIEWS, SIZE, SIZE): mean occupancy along parallel rays."""
        turned = grid_sample(occupancy.expand(VIEWS, 1, -1, -1, -1), lines, align_corners=True)
        return turned[:, 0].mean(1)

    images = projections(ring())
    noise = 0.02 * torch.randn(images.shape, generator=generator)
    images += 7 * avg_pool2d(noise, 7, stride=1, padding=3)  # smoothed noise, in blotches
    logits = torch.full((SIZE, SIZE, SIZE), -2.0, requires_grad=True)

    def data_term() -> Tensor:
        steps = torch.stack([logits.diff(dim=axis).square().mean() for axis in range(3)])
        return (projections(logits.sigmoid()) - images).square().mean() + 1e-4 * steps.sum()

    optimizer = torch.optim.Adam([logits], lr=0.1)
    for _ in range(300):
        optimizer.zero_grad()
        data_term().backward()
        optimizer.step()
    before, fit_before = logits.detach().clone(), data_term().item()
    print(f"before: {describe_surfaces(before)}; data term {fit_before:.2e}")

    loss = tk.TopologyLoss(genus=1, change="remove")
    monitor = tk.TopologyMonitor(loss, every=10, patience=5)
    for step in range(300):
        if monitor(step, logits):
            break
        optimizer.zero_grad()
        (data_term() + loss(logits, keys="volume")).backward()
        optimizer.step()

    fit_after = data_term().item()
    after, rise = logits.detach(), fit_after / fit_before - 1
    print(f"after {step} steps: {describe_surfaces(after)}; data term {fit_after:.2e}, {rise:+.1%}")
    save_pair(picture, before, after, eye=(0.8, 1.0, 1.6), zoom=1.05)


if __name__ == "__main__":
    main()
