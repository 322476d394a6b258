"""Segmentation of noisy vessel trees and membranes by a small U-Net: topology losses beside Dice with cross-entropy.

python -m benchmarks.segmentation                       about 40 minutes of one core
python -m benchmarks.segmentation --families trees --dims 2 --seeds 5 6
python -m benchmarks.segmentation --device cuda --json found.json

Every seed has its own images and its own network, which is trained with Dice and cross-entropy first. Every loss goes
on from there with the same batches, while the learning rate falls to zero. Measured are images that were not trained
on: Dice, clDice, Betti errors and features that are missing and spurious per image, 26- or 8-connected, and CPU time of
a step.
"""

from __future__ import annotations

import argparse
import copy
import json
import statistics
import time
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from monai.losses import DiceCELoss
from monai.networks.nets import UNet
from torch import Tensor, nn

import topokit as tk
from benchmarks.noisy_masks import FAMILIES, noisy_mask
from benchmarks.segmentation_losses import COMPETITORS, Term
from topokit.metrics import TopologyMetric

RATE = 3e-3
TEST_SEEDS = 10_000  # images for testing have seeds from here on


class Sizes(NamedTuple):
    """How large a study is.

    Attributes:
        side: of an image, in voxels.
        n_train: images for training.
        n_test: images for testing.
        batch: images in a step.
        channels: of the network, fine to coarse.
        steps: of training with Dice and cross-entropy, and as many with each loss.
    """

    side: int
    n_train: int
    n_test: int
    batch: int
    channels: tuple[int, ...]
    steps: int


SIZES = {2: Sizes(64, 32, 24, 6, (16, 32, 64), 200), 3: Sizes(32, 16, 12, 2, (8, 16, 32), 100)}
Run = dict[str, dict[str, float]]
"""The measures of each loss, for one seed."""


class Images(NamedTuple):
    """Images (N, 1, …) float32 and masks (N, 1, …) int64."""

    images: Tensor
    masks: Tensor


def images_of(family: str, dims: int, side: int, seeds: range, device: str) -> Images:
    made = [noisy_mask(family, dims, side, seed) for seed in seeds]
    images, masks = np.stack([one.image for one in made]), np.stack([one.mask for one in made])
    return Images(torch.from_numpy(images)[:, None].to(device), torch.from_numpy(masks)[:, None].long().to(device))


def network(dims: int, seed: int) -> nn.Module:
    torch.manual_seed(seed)
    channels = SIZES[dims].channels
    return UNet(dims, 1, 2, channels, strides=(2,) * (len(channels) - 1), num_res_units=1, norm="instance")


def batches(data: Images, size: int, steps: int, seed: int) -> Iterator[Images]:
    """Random batches, mirrored and turned at random."""
    generator = torch.Generator().manual_seed(seed)
    dims = data.images.ndim - 2
    for _ in range(steps):
        chosen = torch.randperm(len(data.images), generator=generator)[:size].to(data.images.device)
        axes = (2 + torch.randperm(dims, generator=generator)).tolist()
        mirrored = [2 + axis for axis in range(dims) if torch.rand((), generator=generator) < 0.5]
        yield Images(*(one[chosen].permute(0, 1, *axes).flip(mirrored) for one in data))


def train(net: nn.Module, data: Images, term: Term, weight: float, steps: int, seed: int, decays: bool) -> list[float]:
    """Train a network in place; CPU seconds of each step."""
    base = DiceCELoss(include_background=False, softmax=True, to_onehot_y=True)
    optimizer = torch.optim.Adam(net.parameters(), RATE)
    rates = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps) if decays else None
    seconds = []
    net.train()
    for image, mask in batches(data, SIZES[data.images.ndim - 2].batch, steps, seed):
        started = time.process_time()
        optimizer.zero_grad()
        logits = net(image)
        loss = base(logits, mask)
        if weight:
            loss = loss + weight * term(logits, mask)
        loss.backward()
        optimizer.step()
        if rates is not None:
            rates.step()
        seconds.append(time.process_time() - started)
    return seconds


@torch.no_grad()
def measured(net: nn.Module, data: Images) -> dict[str, float]:
    """Means over images; features are summed over their dimensions as well."""
    dims = data.images.ndim - 2
    net.eval()
    found = torch.cat([net(one) for one in data.images.split(4)]).argmax(1, keepdim=True)
    metric = TopologyMetric(connectivity=26, dimensions=dims)
    metric.update(found, data.masks)
    numbers = {key: float(value) for key, value in metric.compute().items() if int(key[-1]) < dims}
    pairs = zip(found[:, 0].bool().cpu(), data.masks[:, 0].bool().cpu(), strict=True)
    overlaps = [tk.compare(*(_in_space(one) for one in pair), connectivity=26).agreement for pair in pairs]
    numbers["dice"] = statistics.mean(one.dice for one in overlaps)
    numbers["cl_dice"] = statistics.mean(one.cl_dice or 0.0 for one in overlaps)
    for kind in ("betti_error", "missing", "spurious"):
        numbers[kind] = sum(numbers[f"{kind}{degree}"] for degree in range(dims))
    return numbers


def _in_space(mask: Tensor) -> Tensor:
    return mask.reshape(*mask.shape, *[1] * (3 - mask.ndim))


def study(family: str, dims: int, seed: int, losses: list[str], steps: int, device: str) -> Run:
    """The measures of each loss, for one seed."""
    sizes = SIZES[dims]
    own = range(100 * seed, 100 * seed + sizes.n_train)
    tests = range(TEST_SEEDS + 100 * seed, TEST_SEEDS + 100 * seed + sizes.n_test)
    data, test = (images_of(family, dims, sizes.side, seeds, device) for seeds in (own, tests))
    start = network(dims, seed).to(device)
    train(start, data, COMPETITORS["Dice"].make(), 0.0, steps, seed, decays=False)
    found = {}
    for name in losses:
        one, net = COMPETITORS[name], copy.deepcopy(start)
        seconds = train(net, data, one.make(), one.weight, steps, seed + 1, decays=True)
        found[name] = {**measured(net, test), "seconds": statistics.median(seconds)}
    for one in found.values():
        one["relative"] = one["seconds"] / found["Dice"]["seconds"]
    return found


COLUMNS = {
    "dice": "Dice",
    "cl_dice": "clDice",
    "betti_error0": "β₀ error",
    "betti_error1": "β₁ error",
    "betti_error2": "β₂ error",
    "missing": "missing",
    "spurious": "spurious",
    "seconds": "CPU s a step",
    "relative": "× Dice alone",
}


def table(runs: list[Run]) -> str:
    """Mean ± standard deviation over seeds, one row for each loss."""
    shown = [key for key in COLUMNS if all(key in one for run in runs for one in run.values())]
    lines = ["| loss | " + " | ".join(COLUMNS[key] for key in shown) + " |", "|---" * (1 + len(shown)) + "|"]
    for name in runs[0]:
        cells = []
        for key in shown:
            values = [run[name][key] for run in runs]
            digits = 3 if key in ("dice", "cl_dice", "seconds") else 1 if key == "relative" else 2
            spread = statistics.stdev(values) if len(values) > 1 else 0.0
            cells.append(f"{statistics.mean(values):.{digits}f} ± {spread:.{digits}f}")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Print a table for each seed, and one of means for each family and number of dimensions."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", nargs="+", choices=tuple(FAMILIES), default=list(FAMILIES))
    parser.add_argument("--dims", nargs="+", type=int, choices=tuple(SIZES), default=list(SIZES))
    parser.add_argument("--losses", nargs="+", choices=tuple(COMPETITORS), default=list(COMPETITORS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2, 3, 4])
    parser.add_argument("--steps", type=int, help="before the losses part, and after (200 in the plane, 100 in space)")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--json", type=Path, help="file for the numbers of every run")
    chosen = parser.parse_args()
    runs: dict[str, list[Run]] = {}
    for seed in chosen.seeds:
        for dims, family in product(chosen.dims, chosen.families):
            losses = ["Dice", *(name for name in chosen.losses if name != "Dice" and COMPETITORS[name].takes(dims))]
            one = study(family, dims, seed, losses, chosen.steps or SIZES[dims].steps, chosen.device)
            runs.setdefault(f"{family}, {dims} dimensions", []).append(one)
            print(f"{family}, {dims} dimensions, seed {seed}\n\n{table([one])}\n", flush=True)
            if chosen.json:
                chosen.json.write_text(json.dumps(runs, indent=1), encoding="utf-8")
    for name, several in runs.items():
        print(f"{name}, {len(several)} seeds\n\n{table(several)}\n", flush=True)


if __name__ == "__main__":
    main()
