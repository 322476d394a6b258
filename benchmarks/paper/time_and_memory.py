"""Seconds and peak memory of χ⁽⁰⁾ on a torus, forward and with the gradient, and of a thousand neighbors."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import torch

from benchmarks.paper.tables import Options, Table

SIZES = (2_000, 10_000, 70_000, 1_000_000)
K = 30
PRINTED = {2_000: -3.042, 10_000: -3.013, 70_000: -2.439}  # "Time" of Table I, columns A, B and E
MANY = (100_000, 1_000)  # points and neighbors of the last table
_ROOT = Path(__file__).resolve().parents[2]
_SCRIPT = """
import resource, sys, time
import torch
import topokit as tk
from topokit.testing import torus_samples
n, k, threads, what, area, device = *map(int, sys.argv[1:4]), *sys.argv[4:]
torch.set_num_threads(threads)
known = torus_samples(n)
def run():
    points = known.points.to(device).clone().requires_grad_(what == "backward")
    if device == "cuda":
        torch.cuda.synchronize()
    started, used = time.perf_counter(), time.process_time()
    if what == "curvature":
        tk.from_points(points).curvature(k)
    else:
        value = tk.from_points(points, known.normals.to(device)).gauss_bonnet(k, area_method=area)
        if what == "backward":
            value.backward()
    if device == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter() - started, time.process_time() - used
repeated = n < 100_000
if repeated:
    run()
runs = [run() for _ in range(3 if repeated else 1)]
print(*(min(column) for column in zip(*runs)), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def measure(n: int, k: int, threads: int, what: str, area: str, device: str) -> str:
    """Least seconds of three runs (of 100 000 points and more: one) in a process of its own, and its peak memory."""
    words = [sys.executable, "-c", _SCRIPT, str(n), str(k), str(threads), what, area, device]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=_ROOT)
    seconds, used, peak = map(float, done.stdout.split())
    gibibytes = peak / (1 << 30 if sys.platform == "darwin" else 1 << 20)
    own = "" if device == "cuda" else f" ({used:.2f} CPU s)"
    return f"{seconds:.2f} s{own}, {gibibytes:.2f} GiB"


def sizes_table(options: Options) -> Table:
    """All sizes, one and all threads, exact and Monte Carlo areas, CPU and CUDA."""
    table = Table(
        f"χ⁽⁰⁾ of N points of a torus with normals, k = {K}: least of three runs, peak memory of the process",
        ["N", "paper", "device", "area", "forward", "forward and backward"],
    )
    n_threads = torch.multiprocessing.cpu_count()
    devices = [("CPU, 1 thread", 1, "cpu"), (f"CPU, {n_threads} threads", n_threads, "cpu")]
    if torch.cuda.is_available():
        devices.append((torch.cuda.get_device_name(), 1, "cuda"))
    else:
        table.notes.append("There is no CUDA device here: its rows are left out.")
    sizes = [n for n in SIZES if options.part in ("all", str(n))]
    for n in sizes[:1] if options.quick else sizes:
        printed = f"10^{PRINTED[n]} s" if n in PRINTED else "–"
        for name, threads, device in devices:
            for area in ("exact", "monte-carlo") if n <= 10_000 else ("exact",):
                cells = [measure(n, K, threads, what, area, device) for what in ("forward", "backward")]
                table.add(n, printed, name, area, *cells)
    table.notes.append('The paper prints the logarithm of "Time" without its base or what is timed; 10 is assumed.')
    return table


def neighbors_table(options: Options) -> Table:
    """Curvature with very many neighbors, without normals."""
    n, k = (2_000, 200) if options.quick else MANY
    table = Table(f"`curvature({k})` of {n} points of a torus without normals, one thread", ["time, peak memory"])
    table.add(measure(n, k, 1, "curvature", "exact", "cpu"))
    return table


PARTS = (*map(str, SIZES), "many-neighbors")


def tables(options: Options) -> list[Table]:
    """Seconds and memory by size, and with many neighbors."""
    found = [] if options.part == "many-neighbors" else [sizes_table(options)]
    return [*found, neighbors_table(options)] if options.part in ("all", "many-neighbors") else found
