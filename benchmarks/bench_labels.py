"""Cost of counting all labels of a volume in one pass, beside counting each in its own box.

    python -m pytest benchmarks/bench_labels.py -s

Compact cells, and walls that cross the whole volume, as neurites do: their boxes are as large as the volume.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from topokit.core.blocks.labeled import count_labels
from topokit.core.blocks.whole import count_solid
from topokit.core.grid.grid import Grid
from topokit.core.grid.labels import label_boxes


def cells(side: int, n_cells: int) -> NDArray[np.int64]:
    """The nearest of random seeds, for each voxel."""
    seeds = np.zeros((side,) * 3, np.int64)
    seeds[tuple(np.random.default_rng(0).integers(0, side, (3, n_cells)))] = np.arange(1, n_cells + 1)
    return seeds[tuple(distance_transform_edt(seeds == 0, return_distances=False, return_indices=True))]


def walls(side: int, n_walls: int) -> NDArray[np.int64]:
    """Diagonal walls side by side."""
    x, y, z = np.indices((side,) * 3)
    return (x + y + z) * n_walls // (3 * side) + 1


@pytest.mark.parametrize(("values", "most"), [(cells(128, 600), 1.0), (walls(128, 100), 0.4)], ids=["cells", "walls"])
def test_one_pass_takes_a_share_of_the_time_of_one_by_one(values: NDArray[np.int64], most: float) -> None:
    boxes, volume = label_boxes(torch.from_numpy(values)), torch.from_numpy(values)
    seconds, found = [], []
    for _ in range(2):  # the first time loops are compiled
        started = time.process_time()
        counted = count_labels(values, np.array([*boxes]), 26, Grid(values.shape))
        found.append([counted[label].euler for label in boxes])
        middle = time.process_time()
        one_by_one = [
            count_solid(volume[box], lambda part, own=label: part == own, 26, Grid(volume[box].shape)).euler
            for label, box in boxes.items()
        ]
        found.append(one_by_one)
        seconds = [middle - started, time.process_time() - middle]
    assert found[0] == found[1]
    print(f"\n{len(boxes)} labels: {seconds[0]:.2f} CPU seconds together, {seconds[1]:.2f} one by one")
    assert seconds[0] <= most * seconds[1]
