"""Processes that can be interrupted."""

from __future__ import annotations

import signal


def accept_interrupts() -> None:
    """In the new process: jobs in the background of a shell, and what they start, ignore SIGINT."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
