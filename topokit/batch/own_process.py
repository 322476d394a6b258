"""A function applied in a process that the calling thread keeps for itself, so that limits hold where others decide."""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable
from typing import TypeVar

from topokit.batch.limits import Limits
from topokit.batch.processes import DeathError, Worker

Task = TypeVar("Task")
Result = TypeVar("Result")


class _Own(threading.local):
    def __init__(self) -> None:
        self.workers: dict[Limits, tuple[Worker, tempfile.TemporaryDirectory[str]]] = {}


_own = _Own()


def call_in_own_process(
    function: Callable[[Task], Result], task: Task, after_death: Callable[[Task, str], Result], limits: Limits
) -> Result:
    """The result of a function in another process, which ends if it exceeds a limit, and with this one at the latest.

    Args:
        function: as for `processes.map_in_processes`.
        task: what to call it with.
        after_death: gives the result if the process ends instead, with the reason.
        limits: on the task.
    """
    worker, _ = _own.workers.get(limits, (None, None))
    if worker is None:
        folder = tempfile.TemporaryDirectory(prefix="topokit-", ignore_cleanup_errors=True)
        worker = Worker(1, folder.name, limits)
        _own.workers[limits] = worker, folder  # the folder is removed with the thread
    try:
        return worker.call(function, task)
    except DeathError as death:
        return after_death(task, str(death))
