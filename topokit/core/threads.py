"""Small tensor operations on one thread."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import torch

_entering = threading.Lock()


@contextmanager
def one_thread() -> Iterator[None]:
    """Run torch's CPU operations of the calling thread on one thread, and restore their number afterwards.

    Thousands of short operations gain little from a second thread, while OpenMP's threads spin between them: on a busy
    machine a report of 10 000 points took 20 s on two threads and 6 s on one (see `benchmarks/bench_threads.py`).

    Torch keeps the number for each thread, but a thread takes over the number that any other has set last when it first
    asks. So the old number is set again from elsewhere at once: threads that begin meanwhile must not take over the 1.
    """
    with _entering:
        before = torch.get_num_threads()
        if before > 1:
            torch.set_num_threads(1)
            elsewhere = threading.Thread(target=torch.set_num_threads, args=(before,))
            elsewhere.start()
            elsewhere.join()
    try:
        yield
    finally:
        if before > 1:
            torch.set_num_threads(before)
