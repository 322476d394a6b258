"""A noisy volume shows a washer whose hole was missed: at its thinnest place a skin is left. A loss drills it through.

    python examples/drill_a_hole.py [PICTURE]

The parameters are the grey values themselves; the data term asks them to stay with the measured ones and to be smooth.
The loss may only remove (change="remove"), and what it makes is the smallest hole that counts; to get a wider one, ask
for it at a level somewhat outside. Expect one surface of genus 0 before and one of genus 1 after. Takes a few seconds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from _judge import judged
from _picture import save_pair
from torch import Tensor

import topokit as tk

SIZE = 40


def washer() -> Tensor:
    """Depth (SIZE, SIZE, SIZE) inside a disc that is hollowed out from both sides, down to a thin skin."""
    axis = torch.linspace(-1, 1, SIZE)
    x, y, z = torch.meshgrid(axis, axis, axis, indexing="ij")
    radius = torch.hypot(x, y)
    disc = torch.minimum(0.7 - radius, 0.3 - z.abs())
    return torch.minimum(disc, torch.hypot(radius, z.abs() - 0.75) - 0.67)


def roughness(values: Tensor) -> Tensor:
    """Mean square of the discrete Laplacian, 0-d."""
    inner = values[1:-1, 1:-1, 1:-1]
    around = values[2:, 1:-1, 1:-1] + values[:-2, 1:-1, 1:-1] + values[1:-1, 2:, 1:-1] + values[1:-1, :-2, 1:-1]
    return (around + values[1:-1, 1:-1, 2:] + values[1:-1, 1:-1, :-2] - 6 * inner).square().mean()


def main() -> None:
    parser = argparse.ArgumentParser(description="Drill the hole of a washer that a volume does not show.")
    parser.add_argument("picture", nargs="?", type=Path, default=Path("drill_a_hole.png"))
    picture = parser.parse_args().picture
    torch.set_num_threads(1)  # small tensors; and the same figures on every machine
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
    print(f"before: {judged(before)}; data term {fit_before:.2e}")

    width = 0.1  # the hole has to be there at the level −width, too: so at the level 0 it is more than a pinhole
    loss = tk.EulerLoss(genus=1, change="remove", level=-width)
    monitor = tk.TopologyMonitor(genus=1, level=-width, every=10, patience=10)
    optimizer = torch.optim.Adam([values], lr=2e-3)
    for step in range(300):
        if monitor(step, values):
            break
        optimizer.zero_grad()
        (data_term() + 1e-2 * loss(values, tau=0.025)).backward()
        optimizer.step()

    fit_after = data_term().item()
    print(
        f"after {step} steps: {judged(values.detach())}; data term {fit_after:.2e}, {fit_after / fit_before - 1:+.1%}"
    )
    save_pair(picture, before, values.detach())


if __name__ == "__main__":
    main()
