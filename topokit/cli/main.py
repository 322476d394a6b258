"""The command as it is installed: signals are taken care of before anything else is imported."""

from __future__ import annotations

import atexit
import errno
import os
import sys

from topokit.ending import end_on_signals, leave

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # of a disk


def main() -> None:
    """Run the command line, and end the process."""
    end_on_signals()
    from topokit.cli.app import app

    try:
        app(prog_name="topokit")
    except SystemExit as end:
        _end(end.code)
    except OSError as error:
        if error.errno not in _FULL:
            raise
        leave(1, f"results could not be written ({error.strerror}).")


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
