"""A report and an estimate with torch's default threads against one thread, alone and beside a busy process.

    python benchmarks/bench_threads.py

Limit: the default may take at most 1.5 × the wall time of one thread, also while another process keeps a core busy.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median

import pytest

QUESTION = """
import sys, time, torch
import topokit as tk
from topokit.testing import torus_samples
if sys.argv[1] == "one":
    torch.set_num_threads(1)
shape = torus_samples(5_000)
tk.from_points(torus_samples(500).points).report()
started = time.perf_counter()
tk.from_points(shape.points).report()
print(time.perf_counter() - started)
"""


def seconds(threads: str) -> float:
    command = [sys.executable, "-c", QUESTION, threads]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    running = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


@pytest.mark.parametrize("n_busy", [0, 2])
def test_default_threads_over_one(n_busy: int) -> None:
    with busy_processes(n_busy):
        rows = [(seconds("default"), seconds("one")) for _ in range(3)]
    ratio = median(default / one for default, one in rows)
    print(f"\nreport of 5 000 points beside {n_busy} busy processes: default threads {ratio:.2f} × one thread")
    assert ratio <= 1.5


if __name__ == "__main__":
    sys.exit(pytest.main([__file__, "-s", "-q"]))
