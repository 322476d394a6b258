"""Processor cores: how many this process may use, and small tensor operations on one of them."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path, PurePosixPath

_entering = threading.Lock()


def n_cores() -> int:
    """Processor cores that this process may use, by its affinity and by the quota of its container."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, math.ceil(min(cores, cpu_quota())))


@cache
def cpu_quota(root: Path = Path("/")) -> float:
    """Cores' worth of time that the control groups of this process grant; infinite without a quota or outside Linux.

    A group is limited by all groups above it. In a container the files of its own group are often mounted where those
    of the root belong, so every folder from the group up to the root is read.

    Args:
        root: of the file system.

    Reference:
        https://docs.kernel.org/admin-guide/cgroup-v2.html (cpu.max) and
        https://docs.kernel.org/scheduler/sched-bwc.html (version 1).
    """
    quotas = [math.inf]
    for folder in _groups(root):
        words = _words(folder / "cpu.max")
        words = words or _words(folder / "cpu.cfs_quota_us") + _words(folder / "cpu.cfs_period_us")
        if len(words) == 2 and words[0] not in ("max", "-1"):
            quotas.append(int(words[0]) / int(words[1]))
    return min(quotas)


def _groups(root: Path) -> Iterator[Path]:
    """The folders of the control groups that limit this process; of version 1 those of the controller "cpu"."""
    mounted = root / "sys/fs/cgroup"
    for line in _lines(root / "proc/self/cgroup"):
        _, controllers, group = line.split(":", 2)
        if controllers == "" or "cpu" in controllers.split(","):
            path = PurePosixPath(group.lstrip("/"))
            for above in (path, *path.parents):
                yield mounted / controllers / above


def _words(path: Path) -> list[str]:
    return " ".join(_lines(path)).split()


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text().splitlines()
    except OSError:  # there is no such group or file
        return []


@contextmanager
def one_thread() -> Iterator[None]:
    """Run torch's CPU operations of the calling thread on one thread, and restore their number afterwards.

    Thousands of short operations gain little from a second thread, while OpenMP's threads spin between them: on a busy
    machine a report of 10 000 points took 20 s on two threads and 6 s on one (see `benchmarks/bench_threads.py`).

    Torch keeps the number for each thread, but a thread takes over the number that any other has set last when it first
    asks. So the old number is set again from elsewhere at once: threads that begin meanwhile must not take over the 1.
    """
    import torch  # here, as processes that only start others count cores, too

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
