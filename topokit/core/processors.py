"""How many things can be done at once."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path, PurePosixPath


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
