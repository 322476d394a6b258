"""Make the picture of docs/certify.md: a slice through the cells in which a network's level set is a graph.

python docs/pictures/make_certificate.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw
from torch import Tensor

from topokit.core.implicit.bounds.operations import program_of
from topokit.core.implicit.certificate.cells import Effort, Leaves, Octree

PICTURE = Path(__file__).with_name("certificate.webp")
SIDE, HEIGHT = 640, 0.01
COLORS = ["#dbe9f6", "#b5d4e9", "#7fb9da", "#4997c9", "#1f6fb2", "#08458a", "#08306b"]


def main() -> None:
    """Draw the cells that the slice meets, lighter where they are larger, and the level set."""
    torch.manual_seed(0)
    net = torch.nn.Sequential(
        torch.nn.Linear(3, 16), torch.nn.ReLU(), torch.nn.Linear(16, 16), torch.nn.ReLU(), torch.nn.Linear(16, 1)
    ).requires_grad_(False)

    def function(x: Tensor) -> Tensor:
        balls = [(x - x.new_tensor((at, 0.0, 0.0))).norm(dim=1) - 0.4 for at in (-0.42, 0.42)]
        return 0.1 * net.to(x)(x)[:, 0] + torch.minimum(*balls)

    program = program_of(lambda x: -function(x), torch.full((1, 3), 0.1, dtype=torch.float64), "a network")
    tree = Octree(program, (-1.0,) * 3, (1.0,) * 3, Effort(seconds=600))
    picture = drawn(tree, tree.start())
    axis = (torch.arange(SIDE) + 0.5) * 2 / SIDE - 1
    points = torch.cartesian_prod(-axis, axis)
    inside = function(torch.cat((points.flip(1), torch.full((len(points), 1), HEIGHT)), 1)).reshape(SIDE, SIDE) < 0
    edge = (inside[1:, 1:] != inside[:-1, 1:]) | (inside[1:, 1:] != inside[1:, :-1])
    for row, column in edge.nonzero().tolist():
        picture.putpixel((column, row), (200, 30, 30))
    picture.save(PICTURE, quality=85)
    print(PICTURE, tree.n_bounded, "cells")


def drawn(tree: Octree, leaves: Leaves) -> Image.Image:
    """The cells that meet the plane z = HEIGHT."""
    picture = Image.new("RGB", (SIDE, SIDE), "white")
    pen = ImageDraw.Draw(picture)
    for level in np.unique(leaves.level).tolist():
        low, high = tree.bounds(leaves.index[leaves.level == level], level)
        meets = (low[:, 2] <= HEIGHT) & (high[:, 2] > HEIGHT)
        for a, b in zip(low[meets], high[meets], strict=True):
            left, right = ((end[0] + 1) / 2 * SIDE for end in (a, b))
            top, bottom = ((1 - end[1]) / 2 * SIDE for end in (b, a))
            color = COLORS[min(level, len(COLORS) - 1)]
            pen.rectangle((left, top, right, bottom), fill=color, outline="#55606a")
    return picture


if __name__ == "__main__":
    main()
