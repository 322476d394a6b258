"""Drill the hole of a washer in a noisy volume that shows a thin skin in its place.

    python examples/drill_a_hole.py [PICTURE]

The parameters are the gray values themselves; the data term keeps them near the measured ones, and smooth. The loss may
only remove material (change="remove"). It makes the smallest hole that counts; for a wider one, it is given a level
below zero. Expect one surface of genus 0 before and one of genus 1 after. Takes a few seconds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from _judge import describe_surfaces
from _picture import save_pair
from torch import Tensor

import topokit as tk

SIZE = 40


def washer() -> Tensor:
    """Field (SIZE, SIZE, SIZE), positive inside a disk that is hollowed out from both sides, down to a thin skin."""
    axis = torch.linspace(-1, 1, SIZE)
    x, y, z = torch.meshgrid(axis, axis, axis, indexing="ij")
    radius = torch.hypot(x, y)
    disk = torch.minimum(0.7 - radius, 0.3 - z.abs())
    return torch.minimum(disk, torch.hypot(radius, z.abs() - 0.75) - 0.67)


def roughness(values: Tensor) -> Tensor:
    """Mean square of the discrete Laplacian, 0-d."""
    inner = values[1:-1, 1:-1, 1:-1]
    around = values[2:, 1:-1, 1:-1] + values[:-2, 1:-1, 1:-1] + values[1:-1, 2:, 1:-1] + values[1:-1, :-2, 1:-1]
    return (around + values[1:-1, 1:-1, 2:] + values[1:-1, 1:-1, :-2] - 6 * inner).square().mean()


def main() -> None:
    parser = argparse.ArgumentParser(description="Drill the hole of a washer that a volume does not show.")
    parser.add_argument("picture", nargs="?", type=Path, default=Path("drill_a_hole.png"))
    picture = parser.parse_args().picture
    torch.set_num_threads(1)  # faster for small tensors, and the same numbers on every machine
    depth = washer().clamp(-0.2, 0.2)
    measured = depth + 0.02 * torch.randn(depth.shape, generator=torch.Generator().manual_seed(0))
    values = measured.clone().requires_grad_()
    optimizer = torch.optim.Adam([values], lr=5e-3)

    def data_term() -> Tensor:
        return (values - measured).square().mean() + 2 * roughness(values)

    for _ in range(200):
        optimizer.zero_grad()
        data_term().backward()
        optimizer.step()
    before, fit_before = values.detach().clone(), data_term().item()
    print(f"before: {describe_surfaces(before)}; data term {fit_before:.2e}")

    width = 0.1  # the hole must exist at the level −width, so at the level 0 it is more than a pinhole
    loss = tk.TopologyLoss(genus=1, change="remove", level=-width)
    monitor = tk.TopologyMonitor(loss, every=10, patience=10)
    optimizer = torch.optim.Adam([values], lr=2e-3)
    for step in range(300):
        if monitor(step, values):
            break
        optimizer.zero_grad()
        (data_term() + loss(values, keys="volume")).backward()
        optimizer.step()

    fit_after = data_term().item()
    after, rise = values.detach(), fit_after / fit_before - 1
    print(f"after {step} steps: {describe_surfaces(after)}; data term {fit_after:.2e}, {rise:+.1%}")
    save_pair(picture, before, after)


if __name__ == "__main__":
    main()
