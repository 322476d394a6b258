"""Small tensor operations on one thread."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def one_thread() -> Iterator[None]:
    """Run torch's CPU operations on one thread, and restore the number of threads afterwards.

    Thousands of short operations gain little from a second thread, while OpenMP's threads spin between them: on a busy
    machine a report of 10 000 points took 20 s on two threads and 6 s on one (see `benchmarks/bench_threads.py`).
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
