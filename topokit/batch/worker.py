"""A worker process: takes tasks from its standard input and writes their results to its standard output."""

from __future__ import annotations

import os
import pickle
import signal
import sys


def import_what_is_needed(_: None) -> None:
    """What every file needs: torch, which takes seconds and a fifth of a GiB."""
    import topokit.shape  # noqa: F401


def main() -> None:
    """Answer every pickled (function, task) with the pickled result, until the input ends.

    What libraries print goes to standard error. Signals that end the parent are left to it: it ends its workers.
    """
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as replies:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        while True:
            try:
                function, task = pickle.load(sys.stdin.buffer)
            except EOFError:
                return
            replies.write(pickle.dumps(function(task)))
            replies.flush()
