"""A worker process: takes tasks from its standard input and writes their results to its standard output."""

from __future__ import annotations

import os
import pickle
import signal
import sys
from functools import partial
from types import TracebackType
from typing import BinaryIO

from topokit.errors import summary
from topokit.text import make_logs_printable

LENGTH_BYTES = 8
"""Of the number before every result, little end first: how many bytes follow; 0 before the last words of a process."""


def import_what_is_needed(_: None) -> None:
    """Torch and the libraries behind meshes, clouds and pages: they take seconds, and a third of a GiB."""
    import trimesh

    import topokit as tk
    import topokit.export.picture
    import topokit.pages

    ball = trimesh.creation.icosphere(2)
    for shape in (tk.from_mesh(ball), tk.from_points(ball.vertices, ball.vertex_normals)):
        shape.report()  # libraries import parts of themselves at their first use


def main() -> None:
    """Answer every pickled (function, task) with the pickled result, until the input ends.

    What libraries print goes to standard error. Signals that end the parent are left to it: it ends its workers.
    """
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    replies = os.fdopen(os.dup(sys.stdout.fileno()), "wb")  # ends with the process, after its last words
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    sys.excepthook = partial(_end_with, replies)
    make_logs_printable()
    while True:
        try:
            function, task = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        content = pickle.dumps(function(task))
        try:
            replies.write(len(content).to_bytes(LENGTH_BYTES, "little") + content)
            replies.flush()
        except BrokenPipeError:  # the parent was ended, so nobody reads this or a traceback
            os._exit(1)


def _end_with(replies: BinaryIO, kind: type[BaseException], error: BaseException, where: TracebackType | None) -> None:
    """Tell the parent what ends this process, and print the traceback."""
    replies.write(bytes(LENGTH_BYTES) + summary(error).encode("utf-8", "backslashreplace"))
    replies.flush()
    sys.__excepthook__(kind, error, where)
