"""Processes that can be interrupted."""

from __future__ import annotations

import signal


def accept_interrupts() -> None:
    """In the new process: what a shell starts in the background ignores SIGINT, and what nohup starts SIGHUP."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
