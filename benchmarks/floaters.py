"""Floating parts smaller than a grid's cells: is a network's report ever likely without them?

    python benchmarks/floaters.py

A ball of radius 0.3 and a much smaller one beside it, at eight places, in a box of side 2. Fields that carry distance:
the distance itself and log-odds. Occupancies: sigmoids whose flank is 1/50 to 1/1000 wide. Radii are in shares of the
box's half side, as is a cell: 1/64 on 128 cells. One line for each field and radius: how many reports count both balls,
and what they claim.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import torch
from torch import Tensor

import topokit as tk

Function = Callable[[Tensor], Tensor]

BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
RADII = (0.006, 0.010, 0.014, 0.020, 0.030)
PLACES = 8
SLOPES = (50, 200, 1000)


def with_floater(radius: float, seed: int) -> Function:
    """The distance of a ball and of a small one in a random direction, 0.45 to 0.73 from the middle."""
    direction = torch.randn(3, generator=torch.Generator().manual_seed(seed))
    place = (0.45 + 0.04 * seed) * torch.nn.functional.normalize(direction, dim=0)
    return lambda x: torch.minimum(x.norm(dim=1) - 0.3, (x - place).norm(dim=1) - radius)


def shapes(distance: Function, resolution: int) -> dict[str, tk.Shape]:
    """The same solid as distances, as log-odds and as occupancies."""
    occupancies = {
        f"occupancy, slope {slope}": tk.from_occupancy(
            lambda x, slope=slope: torch.sigmoid(-slope * distance(x)), bounds=BOX, resolution=resolution
        )
        for slope in SLOPES
    }
    return {
        "distance": tk.from_sdf(distance, bounds=BOX, resolution=resolution),
        "log-odds": tk.from_occupancy(lambda x: -200 * distance(x), logits=True, bounds=BOX, resolution=resolution),
        **occupancies,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--resolution", type=int, default=128, help="of the report: the finest grid")
    resolution = parser.parse_args().resolution
    print(
        "| field | radius | both counted, likely | both counted, unsure | one counted, unsure | one counted, likely |"
    )
    print("|---" * 6 + "|")
    kinds = list(shapes(with_floater(RADII[0], 0), resolution))
    for kind in kinds:
        for radius in RADII:
            reports = [shapes(with_floater(radius, seed), resolution)[kind].report() for seed in range(PLACES)]
            answers = [(report.euler, report.verdict) for report in reports]
            cells = [answers.count(one) for one in ((4, "likely"), (4, "unsure"), (2, "unsure"), (2, "likely"))]
            assert sum(cells) == PLACES, answers
            print(f"| {kind} | {radius:.3f} | " + " | ".join(map(str, cells)) + " |", flush=True)


if __name__ == "__main__":
    main()
