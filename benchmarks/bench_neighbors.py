"""Neighbors in torch operations against SciPy's KD-tree, as ratios of CPU time within one run, one thread each.

    OMP_NUM_THREADS=1 python -m pytest benchmarks/bench_neighbors.py -s      also --device cuda, in seconds of the wall

Limits: three times the KD-tree's time for 20 neighbors of 100 000 points of a torus, ten times for 20 000 points of
twenty hostile kinds.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import process_time

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from benchmarks.timing import seconds
from topokit.core.neighbors.device import device_neighbors
from topokit.testing import torus_samples

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from hostile_clouds import CLOUDS

K, LIMIT, ROUNDS = 20, 3.0, 3
HOSTILE_POINTS, HOSTILE_LIMIT = 20_000, 10.0


def kd_tree(points: Tensor) -> Tensor:
    """Build and query in the order of the tree, which is twice as fast."""
    coordinates = points.double().numpy()
    tree = cKDTree(coordinates, balanced_tree=False, compact_nodes=False)
    found = np.empty((len(points), K + 1), dtype=np.int64)
    found[tree.indices] = tree.query(coordinates[tree.indices], K + 1, workers=1)[1]
    return torch.from_numpy(found)[:, 1:]


def in_torch(points: Tensor) -> Tensor:
    return device_neighbors(points[None], K, None, 0)[0]


def timed(work: Callable[[Tensor], Tensor], points: Tensor) -> float:
    return seconds(lambda: work(points), points.device, process_time)


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


def test_at_most_three_kd_trees(device: torch.device) -> None:
    on_host = torus_samples(100_000).points
    points = on_host.to(device)
    assert torch.equal(kd_tree(on_host), in_torch(points).cpu())
    rows = [(timed(kd_tree, on_host), timed(in_torch, points)) for _ in range(ROUNDS)]
    ratio = median(ours / scipy for scipy, ours in rows)
    print(f"\n100 000 points: KD-tree {rows[0][0]:.2f} s, in torch operations {ratio:.2f} times that")
    assert ratio <= LIMIT


@pytest.mark.parametrize("name", CLOUDS)
def test_hostile_clouds(name: str, device: torch.device) -> None:
    """Many points in one place make the KD-tree quadratic; there only our own time is shown."""
    points = CLOUDS[name](HOSTILE_POINTS, torch.Generator().manual_seed(0))
    ours = timed(in_torch, points.to(device))
    if len(points.unique(dim=0)) * 2 < len(points):
        print(f"\n{name}: {ours:.2f} s")
        return
    ratio = ours / timed(kd_tree, points)
    print(f"\n{name}: {ours:.2f} s, {ratio:.1f} KD-trees")
    assert ratio <= HOSTILE_LIMIT
