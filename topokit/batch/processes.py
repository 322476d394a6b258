"""A function applied in several processes, with results as they are known; a process that dies costs one result.

Pools of other packages do not keep what is promised here. In loky one death fails every task that is not done; pebble
knows no limit on memory, imports the caller's main module, so that scripts need a guard, and a process of it that is at
work outlives a parent that ends at once. Nor is it faster: 2 000 empty tasks take 0.13 s there and 0.14 s here.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from typing import IO, Any, TypeVar

import cloudpickle

from topokit.batch.limits import NO_LIMITS, Limits, memory_of, watched
from topokit.batch.worker_process import LENGTH_BYTES, import_what_is_needed
from topokit.core.processors import n_cores
from topokit.ending import finally_do
from topokit.errors import InputError, summary

Task = TypeVar("Task")
Result = TypeVar("Result")

_AHEAD = 1024  # tasks begun behind one that is not done: enough to work on, few enough to hold until they are in order
_START = "import sys; sys.path[:] = {path!r}; from topokit.batch.worker_process import main; main()"
# A process group of its own: an interrupt from the keyboard goes to a whole group, and the parent ends its workers.
_APART: dict[str, Any] = {"creationflags": 0x200} if sys.platform == "win32" else {"process_group": 0}
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def map_in_processes(
    function: Callable[[Task], Result],
    tasks: Iterable[Task],
    jobs: int,
    after_death: Callable[[Task, str], Result],
    limits: Limits = NO_LIMITS,
) -> Generator[tuple[int, Result]]:
    """The results of a function with the numbers of their tasks, as they are known.

    The processes import the function by its name, but not the caller's main module, so a script needs no guard: what
    it defines is sent as code. Each process has its share of the cores for threads of its own, unless the environment
    says otherwise. They end with the iterator, and what they have left in the folder for temporary files is removed.

    Args:
        function: of a module, so that it can be pickled; the result, too.
        tasks: what to call it with, one at a time.
        jobs: number of processes.
        after_death: gives, for the task whose process died and the reason, the result in its place.
        limits: on each task; a process that exceeds one is ended.
    """
    folder = tempfile.TemporaryDirectory(prefix="topokit-", ignore_cleanup_errors=True)
    workers = [Worker(max(1, n_cores() // jobs), folder.name, limits) for _ in range(jobs)]
    idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
    for worker in workers:
        idle.put(worker)

    def run(task: Task) -> Result:
        worker = idle.get()
        try:
            result: Result = worker.call(function, task)
            return result
        except DeathError as death:
            return after_death(task, str(death))
        finally:
            idle.put(worker)

    def kill() -> None:
        for worker in workers:
            worker.kill()

    threads = ThreadPoolExecutor(jobs)
    try:
        with finally_do(folder.cleanup), finally_do(kill):
            begun: dict[Future[Result], int] = {}  # in the order of the tasks
            done: queue.SimpleQueue[Future[Result]] = queue.SimpleQueue()
            for number, task in enumerate(tasks):
                future = threads.submit(run, task)
                begun[future] = number
                future.add_done_callback(done.put)
                while begun and number - next(iter(begun.values())) >= _AHEAD - 1:
                    yield begun.pop(known := done.get()), known.result()
            while begun:
                yield begun.pop(known := done.get()), known.result()
    finally:
        threads.shutdown(cancel_futures=True)
        for worker in workers:
            worker.close()


class DeathError(Exception):
    """A process ended before it answered; the message says how."""


class _LastWordsError(EOFError):
    """An exception ended a process; the message is what it said of it."""


class Worker:
    """A process that answers one task at a time; it is started with the first one, and again after its death."""

    def __init__(self, n_threads: int, folder: str, limits: Limits) -> None:
        self._limits = limits
        self._least = 0.0  # GiB of the process before its first task
        threads = {name: str(n_threads) for name in _THREADS} | {"OMP_WAIT_POLICY": "passive"}
        self._environment = threads | os.environ | dict.fromkeys(("TMPDIR", "TEMP", "TMP"), folder)
        self._process: subprocess.Popen[bytes] | None = None
        self._is_stopped = False

    def call(self, function: Callable[[Task], Result], task: Task) -> Result:
        """What the function returns in the process.

        Raises:
            DeathError: if the process ends instead, or is ended for exceeding a limit.
        """
        process = self._ready()
        exceeded: list[str] = []

        def end(reason: str) -> None:
            exceeded.append(reason)
            process.kill()

        try:
            with watched(self._limits, process.pid, end):
                content = _reply(process, function, task)
        except (EOFError, OSError) as error:
            ended = _how_it_ended(self.close(), error)
            raise DeathError(exceeded[0] if exceeded else ended) from None
        if exceeded:  # it was ended just after its answer
            self.close()
        else:
            self._replace_if_full(process)
        result: Result = pickle.loads(content)  # beyond the limits: it may import what the caller lacks
        return result

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

    def _ready(self) -> subprocess.Popen[bytes]:
        """The process, which is started if need be; interrupts from the keyboard do not reach it."""
        if self._is_stopped:
            raise DeathError("it was stopped")
        if self._process is None:
            command = [sys.executable, "-c", _START.format(path=sys.path)]
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=self._environment, **_APART
            )
            if self._limits:
                self._warm_up(self._process)
        return self._process

    def _warm_up(self, process: subprocess.Popen[bytes]) -> None:
        """Let the process import what every task needs, which no limit counts, and note the memory that this takes."""
        try:
            _reply(process, import_what_is_needed, None)
        except (EOFError, OSError) as error:
            raise DeathError(_how_it_ended(self.close(), error)) from None
        self._least = memory_of(process.pid)

    def _replace_if_full(self, process: subprocess.Popen[bytes]) -> None:
        """End a process that has kept half of the memory it may use: it would fail the next task for this one's."""
        most = self._limits.gibibytes
        if most is not None and memory_of(process.pid) > (self._least + most) / 2:
            self.close()


def _reply(process: subprocess.Popen[bytes], function: Callable[[Task], Result], task: Task) -> bytes:
    """What the function returns in the process, pickled."""
    requests, replies = process.stdin, process.stdout
    assert requests is not None
    assert replies is not None
    requests.write(_packed(function, task))
    requests.flush()
    if n_bytes := int.from_bytes(_read(replies, LENGTH_BYTES), "little"):
        return _read(replies, n_bytes)
    raise _LastWordsError(replies.read().decode())


def _packed(function: Callable[[Task], Result], task: Task) -> bytes:
    """Both as bytes; what scripts and notebooks define, such as the function of a shape, travels as code."""
    try:
        return cloudpickle.dumps((function, task))
    except (pickle.PicklingError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{getattr(task, 'name', task)} cannot be sent to another process ({summary(error)}): pass jobs=1, without "
            "limits of time and memory."
        ) from error


def _read(stream: IO[bytes], n_bytes: int) -> bytes:
    content = stream.read(n_bytes)
    if len(content) < n_bytes:
        raise EOFError
    return content


def _how_it_ended(code: int, noticed: Exception) -> str:
    if isinstance(noticed, _LastWordsError):
        return f"its process ended with {noticed}"
    if code >= 0:
        return f"its process died (exit code {code})"
    name = signal.Signals(-code).name
    perhaps = ": perhaps the memory was used up" if name == "SIGKILL" else ""
    return f"its process died ({name}, {signal.strsignal(-code)}{perhaps})"


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
