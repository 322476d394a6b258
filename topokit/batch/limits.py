"""Limits on the time and the memory that one file may take."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

_STEP = 0.05
"""Seconds between two looks: a process that fills memory at 4 GB/s exceeds its limit by a fifth of a GB."""


@dataclass(frozen=True)
class Limits:
    """The most that one file may take; None is as much as there is.

    Memory is what the process holds in RAM, looked at while it works. A limit on its addresses (RLIMIT_AS) would count
    libraries and files that are only mapped, and a failed allocation would look like a damaged file.

    Attributes:
        seconds: of wall clock, without the start of a process.
        gibibytes: of memory of the process, of which Python and torch take 0.3.
    """

    seconds: float | None = None
    gibibytes: float | None = None

    def __bool__(self) -> bool:
        return self != Limits()

    def exceeded(self, pid: int, started: float) -> str | None:
        """Which limit a process exceeds, as a sentence without its end; None if it exceeds none.

        Args:
            pid: of the process.
            started: when it began to work, by `time.monotonic`.
        """
        if self.seconds is not None and time.monotonic() - started > self.seconds:
            return f"it took longer than the time limit of {self.seconds:g} s"
        if self.gibibytes is not None and memory_of(pid) > self.gibibytes:
            return f"it needed more than the memory limit of {self.gibibytes:g} GiB"
        return None


NO_LIMITS = Limits()


def memory_of(pid: int) -> float:
    """GiB of RAM that a process holds; 0 if there is none of this number."""
    import psutil

    try:
        return psutil.Process(pid).memory_info().rss / (1 << 30)
    except psutil.Error:
        return 0.0


@contextmanager
def watched(limits: Limits, pid: int, end: Callable[[str], object]) -> Iterator[None]:
    """Look at a process during the block, and end it once if it exceeds a limit.

    Args:
        limits: its limits.
        pid: its number.
        end: ends it; it is given the limit that was exceeded, from a thread of its own.
    """
    if not limits:
        yield
        return
    is_over = threading.Event()
    started = time.monotonic()

    def look() -> None:
        while not is_over.wait(_STEP):
            if (reason := limits.exceeded(pid, started)) is not None:
                end(reason)
                return

    watcher = threading.Thread(target=look, name="limits", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        is_over.set()
        watcher.join()
