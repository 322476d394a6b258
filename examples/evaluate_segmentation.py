"""Evaluate two segmentations of vessels in a loop of torchmetrics: the one with the better Dice has the worse topology.

pip install torchmetrics
python examples/evaluate_segmentation.py
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import conv3d, max_pool3d
from torchmetrics import MetricCollection
from torchmetrics.classification import BinaryF1Score

from topokit.metrics import TopologyMetric

SHOWN = ("dice", "betti_error0", "betti_error1", "missing0", "spurious0", "spurious1")


def vessels(seed: int) -> tuple[Tensor, Tensor]:
    """A noisy image and the true mask (1, 1, 40, 40, 40) of three tubes that wander through it."""
    generator = torch.Generator().manual_seed(seed)
    steps = torch.randn(3, 2, 40, generator=generator).cumsum(2)
    centers = (steps - steps.mean(2, keepdim=True) + 20).round().long().clamp(4, 35)
    thread = torch.zeros(1, 1, 40, 40, 40)
    for y, z in centers:
        for x in range(40):
            before = max(0, x - 1)
            ys, zs = sorted((y[before], y[x])), sorted((z[before], z[x]))
            thread[0, 0, x, ys[0] : ys[1] + 1, zs[0] : zs[1] + 1] = 1
    mask = max_pool3d(thread, 5, 1, 2)
    return mask + 0.7 * torch.randn(mask.shape, generator=generator), mask > 0.5


def smoothed(image: Tensor, width: int) -> Tensor:
    """Means over cubes of some voxels."""
    kernel = torch.full((1, 1, width, width, width), 1 / width**3)
    return conv3d(image, kernel, padding=width // 2)


def main() -> None:
    """Segment ten volumes in two ways, and print the means of both."""
    found = {}
    for name, width in (("smoothed a little", 3), ("smoothed a lot", 5)):
        metrics = MetricCollection(
            {"topology": TopologyMetric(connectivity=26).as_torchmetrics(), "dice": BinaryF1Score()}
        )
        for seed in range(10):
            image, truth = vessels(seed)
            metrics.update((smoothed(image, width) > 0.5).float(), truth.int())
        found[name] = metrics.compute()
        print(f"{name}: {', '.join(f'{key} {found[name][key]:.3g}' for key in SHOWN)}")
    little, lot = found.values()
    assert little["dice"] > lot["dice"]
    assert little["betti_error0"] > 1 > lot["betti_error0"]


if __name__ == "__main__":
    main()
