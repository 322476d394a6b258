"""Seconds and peak memory of χ⁽⁰⁾ on a torus, forward and with the gradient."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import torch

from benchmarks.paper.tables import Options, Table

SIZES = (2_000, 10_000, 70_000, 1_000_000)
K = 30
PRINTED = {2_000: -3.042, 10_000: -3.013, 70_000: -2.439}  # "Time" of Table I, columns A, B and E
_ROOT = Path(__file__).resolve().parents[2]
_SCRIPT = """
import resource, sys, time
import torch
import topokit as tk
from topokit.testing import torus_samples
n, threads, area, device, backward = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], sys.argv[4], sys.argv[5] == "1"
torch.set_num_threads(threads)
known = torus_samples(n)
def run():
    points = known.points.to(device).clone().requires_grad_(backward)
    if device == "cuda":
        torch.cuda.synchronize()
    started = time.perf_counter()
    value = tk.from_points(points, known.normals.to(device)).euler(30, area_method=area)
    if backward:
        value.backward()
    if device == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter() - started
run() if n < 100_000 else None
print(sorted(run() for _ in range(3 if n < 100_000 else 1))[0], resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def measure(n: int, threads: int, area: str, device: str, backward: bool) -> str:
    """Best of three runs in a process of its own, and its peak memory."""
    words = [sys.executable, "-c", _SCRIPT, str(n), str(threads), area, device, str(int(backward))]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=_ROOT)
    seconds, kibibytes = done.stdout.split()
    unit = 1 << 30 if sys.platform == "darwin" else 1 << 20
    return f"{float(seconds):.3f} s, {int(kibibytes) / unit:.2f} GiB"


def tables(options: Options) -> list[Table]:
    """All sizes, one and all threads, exact and Monte Carlo areas, CPU and CUDA."""
    table = Table(
        f"χ⁽⁰⁾ of N points of a torus with normals, k = {K}: best of three, peak memory of the process",
        ["N", "paper", "device", "area", "forward", "forward and backward"],
    )
    all_threads = torch.multiprocessing.cpu_count()
    devices = [("CPU, 1 thread", 1, "cpu"), (f"CPU, {all_threads} threads", all_threads, "cpu")]
    if torch.cuda.is_available():
        devices.append((torch.cuda.get_device_name(), 1, "cuda"))
    else:
        table.notes.append("There is no CUDA device here: its rows are left out.")
    for n in SIZES[:1] if options.quick else SIZES:
        printed = f"10^{PRINTED[n]} s" if n in PRINTED else "–"
        for name, threads, device in devices:
            for area in ("exact", "monte-carlo") if n < 100_000 else ("exact",):
                cells = [measure(n, threads, area, device, backward) for backward in (False, True)]
                table.add(n, printed, name, area, *cells)
    table.notes.append('The paper prints the logarithm of "Time" without its base or what is timed; 10 is assumed.')
    return [table]
