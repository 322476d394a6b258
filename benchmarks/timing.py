"""Seconds of calls whose work may still be queued on a device when they return."""

from __future__ import annotations

import time
from collections.abc import Callable

import torch


def seconds(work: Callable[[], object], device: torch.device, clock: Callable[[], float] = time.perf_counter) -> float:
    """Seconds that a call takes, until the device has done what it was given.

    Args:
        work: what is timed.
        device: where it works.
        clock: on the CPU; `time.process_time` where other processes disturb. On devices it is always the wall's.
    """
    on_device = device.type != "cpu"
    tell = time.perf_counter if on_device else clock
    if on_device:
        torch.accelerator.synchronize(device)
    started = tell()
    work()
    if on_device:
        torch.accelerator.synchronize(device)
    return tell() - started
