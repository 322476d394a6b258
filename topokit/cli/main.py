"""The command as it is installed: signals are taken care of before anything else is imported."""

from __future__ import annotations

import atexit
import os
import sys

from topokit.ending import end_on_signals


def main() -> None:
    """Run the command line, and end the process."""
    end_on_signals()
    from topokit.cli.app import app

    try:
        app(prog_name="topokit")
    except SystemExit as end:
        _end(end.code)


def _end(code: object) -> None:
    """What Python does at the end, without taking its modules apart.

    That takes 0.2 s with torch, in which Python no longer handles signals: one of them would end the process with
    another exit code and without a message.
    """
    if code is not None and not isinstance(code, int):
        print(code, file=sys.stderr)
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code if isinstance(code, int) else int(code is not None))
