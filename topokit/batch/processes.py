"""A function applied in several processes, with results in order; a process that dies costs one result."""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from typing import IO, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

_AHEAD = 256  # tasks begun before the first result is taken: enough to work on behind a slow one, few enough to keep
_START = "import sys; sys.path[:] = {path!r}; from topokit.batch.worker import main; main()"
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def n_cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def map_in_processes(
    function: Callable[[Task], Result],
    tasks: Iterable[Task],
    jobs: int,
    after_death: Callable[[Task, str], Result],
) -> Generator[Result]:
    """The results of a function in the order of its tasks, each as soon as it and those before it are known.

    The processes import the function by its name, but not the caller's main module, so a script needs no guard. Each
    has its share of the cores for threads of its own, unless the environment says otherwise. They end with the
    iterator.

    Args:
        function: of a module, so that it can be pickled; the result, too.
        tasks: what to call it with, one at a time.
        jobs: number of processes.
        after_death: gives, for the task whose process died and the reason, the result in its place.
    """
    workers = [_Worker(max(1, n_cores() // jobs)) for _ in range(jobs)]
    idle: queue.SimpleQueue[_Worker] = queue.SimpleQueue()
    for worker in workers:
        idle.put(worker)

    def run(task: Task) -> Result:
        worker = idle.get()
        try:
            result: Result = worker.call(function, task)
            return result
        except _DeathError as death:
            return after_death(task, str(death))
        finally:
            idle.put(worker)

    threads = ThreadPoolExecutor(jobs)
    try:
        waiting: deque[Future[Result]] = deque()
        for task in tasks:
            waiting.append(threads.submit(run, task))
            if len(waiting) >= _AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for worker in workers:
            worker.kill()
        threads.shutdown(cancel_futures=True)
        for worker in workers:
            worker.close()


class _DeathError(Exception):
    """A process ended before it answered; the message says how."""


class _Worker:
    """A process that answers one task at a time; it is started with the first one, and again after its death."""

    def __init__(self, n_threads: int) -> None:
        threads = {name: str(n_threads) for name in _THREADS} | {"OMP_WAIT_POLICY": "passive"}
        self._environment = threads | os.environ | {"TTY_INTERACTIVE": "0"}  # rich draws no bars, which would overlap
        self._process: subprocess.Popen[bytes] | None = None
        self._is_stopped = False

    def call(self, function: Callable[[Task], Result], task: Task) -> Result:
        """What the function returns in the process.

        Raises:
            _DeathError: if the process ends instead.
        """
        message = pickle.dumps((function, task))
        requests, replies = self._pipes()
        try:
            requests.write(message)
            requests.flush()
            result: Result = pickle.load(replies)
            return result
        except (EOFError, OSError, pickle.UnpicklingError):
            raise _DeathError(_how_it_ended(self.close())) from None

    def kill(self) -> None:
        """End the process, whatever it does; no other is started."""
        self._is_stopped, process = True, self._process
        if process is not None:
            process.kill()

    def close(self) -> int:
        """Wait until the process ends, and return its exit code."""
        process, self._process = self._process, None
        if process is None:
            return 0
        with suppress(BrokenPipeError), process:  # closes the pipes, whereupon the process ends, and waits
            pass
        return process.returncode

    def _pipes(self) -> tuple[IO[bytes], IO[bytes]]:
        """The input and output of the process, which is started if need be."""
        if self._is_stopped:
            raise _DeathError("stopped")
        if self._process is None:
            command = [sys.executable, "-c", _START.format(path=sys.path)]
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=self._environment
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        return self._process.stdin, self._process.stdout


def _how_it_ended(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    name = signal.Signals(-code).name
    return f"{name}, {signal.strsignal(-code)}" + (": perhaps the memory was used up" if name == "SIGKILL" else "")
