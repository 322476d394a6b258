"""Seconds and memory of a report against the number of points, on analytic shapes, with their slopes.

python benchmarks/scale.py [--most 10000000] [--sizes N ...]

Each size runs in a process of its own, so that its peak memory is its own. The points lie on three linked thin tori
without normals (χ = 0). Processor seconds are those of all threads, which a busy machine changes least. The slopes are
the exponents of processor seconds and of memory beyond the points between two sizes: 1 is linear.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import subprocess
import sys
import time

SIZES = (10_000, 30_000, 100_000, 300_000, 1_000_000, 2_000_000, 5_000_000, 10_000_000)
MEBIBYTE = 1 << 20


def measure(n_points: int) -> dict[str, float | str | None]:
    """One report: seconds, peak memory of the process in bytes, and the answer."""
    import torch

    import topokit as tk
    from topokit.testing import torus_samples

    part = torus_samples(n_points // 3, minor=0.1).points
    turned = [
        part[:, [0, 2, 1]] + part.new_tensor([1.2, 0, 0]),
        part,
        part[:, [0, 2, 1]] - part.new_tensor([1.2, 0, 0]),
    ]
    points = torch.cat(turned)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    started, worked = time.perf_counter(), time.process_time()
    report = tk.from_points(points).report()
    seconds, cpu = time.perf_counter() - started, time.process_time() - worked
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    found: dict[str, float | str | None] = {"n": len(points), "seconds": seconds, "cpu": cpu}
    return {**found, "before": before, "peak": peak, "euler": report.euler, "verdict": report.verdict}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--most", type=int, default=2_000_000, help="largest number of points")
    parser.add_argument("--sizes", type=int, nargs="*", help="these numbers of points instead")
    parser.add_argument("--only", type=int, help="measure one size and print JSON")
    given = parser.parse_args()
    if given.only:
        print(json.dumps(measure(given.only)))
        return
    print(f"{'points':>12}{'seconds':>10}{'CPU s':>8}{'slope':>7}{'MiB':>8}{'slope':>7}{'χ':>4}  verdict")
    last = None
    for size in given.sizes or [size for size in SIZES if size <= given.most]:
        command = [sys.executable, __file__, "--only", str(size)]
        row = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        cpu, memory = (slope(last, row, name) for name in ("cpu", "peak"))
        print(
            f"{row['n']:>12}{row['seconds']:>10.1f}{row['cpu']:>8.1f}{cpu:>7.2f}{row['peak'] / MEBIBYTE:>8.0f}"
            f"{memory:>7.2f}{row['euler']:>4}  {row['verdict']}",
            flush=True,
        )
        last = row


def slope(last: dict[str, float] | None, row: dict[str, float], name: str) -> float:
    """The exponent with which a cost grows from one size to the next; of memory, that beyond the start."""
    if last is None:
        return math.nan
    first, second = ((one[name] - one["before"] if name == "peak" else one[name]) for one in (last, row))
    return math.log(second / first) / math.log(row["n"] / last["n"])


if __name__ == "__main__":
    main()
