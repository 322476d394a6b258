"""A worker process: takes tasks from its standard input and writes their results to its standard output."""

from __future__ import annotations

import os
import pickle
import signal
import sys

LENGTH_BYTES = 8
"""Of the number before every result, little end first: how many bytes follow."""


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
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as replies:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        while True:
            try:
                function, task = pickle.load(sys.stdin.buffer)
            except EOFError:
                return
            content = pickle.dumps(function(task))
            replies.write(len(content).to_bytes(LENGTH_BYTES, "little") + content)
            replies.flush()
