"""A worker process: takes tasks from its standard input and writes their results to its standard output."""

from __future__ import annotations

import os
import pickle
import signal
import sys


def main() -> None:
    """Answer every pickled (function, task) with the pickled result, until the input ends.

    What libraries print goes to standard error. An interrupt from the keyboard is left to the parent process.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as replies:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        while True:
            try:
                function, task = pickle.load(sys.stdin.buffer)
            except EOFError:
                return
            replies.write(pickle.dumps(function(task)))
            replies.flush()
