"""The cost of χ⁽⁰⁾ against its floor, the k-nearest-neighbor query, as ratios within one run.

    python -m pytest benchmarks/bench_core.py -s      also --device cuda, where the query stays on the CPU

Limits, for 10 000 and 100 000 points of a torus and k = 20:

- `from_points(points, normals).gauss_bonnet()` takes at most 6 times as long as building a KD-tree and querying it on
  all cores;
- the backward pass takes at most 3 times as long as the forward pass with a graph;
- a million points without a graph need less than 4 GiB;
- neighbors found by threads that an interrupt cannot harm take at most 1.3 times as long as with SciPy's own threads.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from statistics import median

import pytest
import torch
from pytest_benchmark.fixture import BenchmarkFixture
from scipy.spatial import cKDTree

import topokit as tk
from benchmarks.timing import seconds
from topokit.core.neighbors.kd_tree import nearest_in_tree
from topokit.testing import AnalyticSamples, torus_samples

SIZES = [10_000, 100_000]
ROUNDS = 5
FORWARD_LIMIT, BACKWARD_LIMIT, MEMORY_LIMIT = 6.0, 3.0, 4.0  # ratios, and GiB
QUERY_LIMIT = 1.3  # ratio
CPU = torch.device("cpu")


def test_interruptible_query() -> None:
    points = torus_samples(100_000).points.numpy()
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    points = points[tree.indices]
    ratios = []
    for _ in range(ROUNDS):
        by_scipy = seconds(lambda: tree.query(points, 21, workers=-1), CPU)
        ratios.append(seconds(lambda: nearest_in_tree(tree, points, 21), CPU) / by_scipy)
    print(f"interruptible query: {median(ratios):.2f} of SciPy's threads")
    assert median(ratios) < QUERY_LIMIT


def query(known: AnalyticSamples) -> None:
    points = known.points.numpy()
    cKDTree(points).query(points, k=21, workers=-1)  # 20 neighbors and the point itself


def euler(known: AnalyticSamples, with_normals: bool = True) -> torch.Tensor:
    return tk.from_points(known.points, normals=known.normals if with_normals else None).gauss_bonnet()


def torus(n_points: int, device: torch.device) -> AnalyticSamples:
    known = torus_samples(n_points)
    return replace(known, points=known.points.to(device), normals=known.normals.to(device))


@pytest.mark.parametrize("n_points", SIZES)
def test_query_alone(benchmark: BenchmarkFixture, n_points: int) -> None:
    benchmark(query, torus_samples(n_points))


@pytest.mark.parametrize("n_points", SIZES)
def test_euler_alone(benchmark: BenchmarkFixture, n_points: int, device: torch.device) -> None:
    known = torus(n_points, device)
    benchmark(lambda: float(euler(known)))  # the number is there when the device has finished


@pytest.mark.parametrize("n_points", SIZES)
@pytest.mark.parametrize("with_normals", [True, False])
def test_forward_is_a_few_queries(n_points: int, with_normals: bool, device: torch.device) -> None:
    """Query and estimate in turn, so that a slow moment of the machine hits both."""
    on_host, known = torus_samples(n_points), torus(n_points, device)
    euler(known, with_normals)
    rows = [
        (seconds(lambda: query(on_host), CPU), seconds(lambda: euler(known, with_normals), device))
        for _ in range(ROUNDS)
    ]
    floor, forward = (median(column) for column in zip(*rows, strict=True))
    ratio = median(row[1] / row[0] for row in rows)
    kind = "given" if with_normals else "estimated"
    print(f"\n{n_points} points, {kind} normals: query {floor:.3f} s, χ⁽⁰⁾ {forward:.3f} s, ratio {ratio:.2f}")
    if with_normals:
        assert ratio <= FORWARD_LIMIT


@pytest.mark.parametrize("n_points", SIZES)
@pytest.mark.parametrize("with_normals", [True, False])
def test_backward_is_at_most_three_forwards(n_points: int, with_normals: bool, device: torch.device) -> None:
    known = torus(n_points, device)
    ratios = []
    for _ in range(ROUNDS):
        points = known.points.clone().requires_grad_()
        shape = tk.from_points(points, normals=known.normals if with_normals else None)
        values: list[torch.Tensor] = []
        forward = seconds(lambda shape=shape, values=values: values.append(shape.gauss_bonnet()), device)
        ratios.append(seconds(values[0].backward, device) / forward)
    print(f"\n{n_points} points: backward / forward {median(ratios):.2f}")
    assert median(ratios) <= BACKWARD_LIMIT


def test_memory_of_a_million_points() -> None:
    script = (
        "import resource\n"
        "from benchmarks.bench_core import euler, torus_samples\n"
        "print(float(euler(torus_samples(1_000_000))), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    value, peak = found.stdout.split()
    gib = int(peak) * (1 if sys.platform == "darwin" else 1024) / 2**30
    print(f"\na million points: χ⁽⁰⁾ {float(value):.3f}, peak memory {gib:.2f} GiB")
    assert abs(float(value)) < 0.5
    assert gib < MEMORY_LIMIT


if __name__ == "__main__":
    sys.exit(pytest.main([__file__, "-s", "-k", "few or three or memory"]))
