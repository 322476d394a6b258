"""The local half against its floor, the KD-tree query: ratios within one run.

    python -m pytest benchmarks/bench_core.py -s

Asked for: forward at most 6 × the query alone; backward at most 3 × forward; a million points forward without gradient
below 4 GiB.
"""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from statistics import median
from time import perf_counter

import pytest
import torch
from pytest_benchmark.fixture import BenchmarkFixture

from topokit.core.local.curvature import surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.neighbors import nearest_neighbors
from topokit.core.samples import SurfaceSamples
from topokit.testing import torus_samples

SIZES = [10_000, 100_000]


def euler(points: torch.Tensor, normals: torch.Tensor | None = None) -> torch.Tensor:
    local = surface_curvature(SurfaceSamples(points, normals))
    return euler_characteristic(local.gaussian, local.area)


@pytest.mark.parametrize("n_points", SIZES)
def test_query_alone(benchmark: BenchmarkFixture, n_points: int) -> None:
    benchmark(nearest_neighbors, torus_samples(n_points).points, 20)


@pytest.mark.parametrize("n_points", SIZES)
@torch.no_grad()
def test_forward(benchmark: BenchmarkFixture, n_points: int) -> None:
    benchmark(euler, torus_samples(n_points).points)


@pytest.mark.parametrize("n_points", SIZES)
@pytest.mark.parametrize("with_normals", [False, True])
def test_ratios(n_points: int, with_normals: bool) -> None:
    """Query, forward and backward in turn, so that a slow moment of the machine hits all three."""
    known = torus_samples(n_points)
    normals = known.normals if with_normals else None
    rows = []
    for _ in range(9):
        times = [perf_counter()]
        nearest_neighbors(known.points, 20)
        times.append(perf_counter())
        with torch.no_grad():
            euler(known.points, normals)
        times.append(perf_counter())
        points = known.points.clone().requires_grad_()
        value = euler(points, normals)
        times.append(perf_counter())
        value.backward()
        times.append(perf_counter())
        rows.append([after - before for before, after in pairwise(times)])
    forward = median(row[1] / row[0] for row in rows)
    backward = median(row[3] / row[2] for row in rows)
    kind = "given" if with_normals else "estimated"
    print(f"\n{n_points} points, {kind} normals, query {median(row[0] for row in rows):.3f} s")
    print(f"forward / query {forward:.2f}, backward / forward {backward:.2f}")


def test_memory_of_a_million_points() -> None:
    script = (
        "import torch, resource\n"
        "from benchmarks.bench_core import euler, torus_samples\n"
        "points = torus_samples(1_000_000).points\n"
        "with torch.no_grad(): value = float(euler(points))\n"
        "print(value, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    value, peak = found.stdout.split()
    unit = 1 if sys.platform == "darwin" else 1024
    print(f"\na million points: χ⁽⁰⁾ {float(value):.3f}, peak memory {int(peak) * unit / 2**30:.2f} GiB")


if __name__ == "__main__":
    sys.exit(pytest.main([__file__, "-s", "-k", "ratios or memory"]))
