"""Seconds and memory of a report against the number of points, on analytic shapes, with the slope of both.

python benchmarks/scale.py [--most 10000000]

Each size runs in a process of its own, so that its peak memory is its own. The points lie on three linked thin tori
without normals (χ = 0); the last column is the exponent of seconds between two sizes: 1 is linear.
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


def measure(n_points: int) -> dict[str, float]:
    """One report: seconds, peak memory of the process in bytes, and the integer."""
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
    started = time.perf_counter()
    report = tk.from_points(points).report()
    seconds = time.perf_counter() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return {"n": len(points), "seconds": seconds, "before": before, "peak": peak, "euler": report.euler or 0}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--most", type=int, default=2_000_000, help="largest number of points")
    parser.add_argument("--only", type=int, help="measure one size and print JSON")
    given = parser.parse_args()
    if given.only:
        print(json.dumps(measure(given.only)))
        return
    print(f"{'points':>12}{'seconds':>10}{'MiB':>8}{'χ':>4}{'slope':>8}")
    last = None
    for size in SIZES:
        if size > given.most:
            break
        command = [sys.executable, __file__, "--only", str(size)]
        row = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        slope = math.nan
        if last is not None:
            slope = math.log(row["seconds"] / last["seconds"]) / math.log(row["n"] / last["n"])
        print(
            f"{row['n']:>12}{row['seconds']:>10.2f}{row['peak'] / MEBIBYTE:>8.0f}{row['euler']:>4}{slope:>8.2f}",
            flush=True,
        )
        last = row


if __name__ == "__main__":
    main()
