"""How blocks end: acts that are done even if a signal ends the process, and output that is written whole.

An interrupt normally arrives as a KeyboardInterrupt at any place of the main thread. Python callers get just that. The
command line cannot rely on it: libraries swallow it (`except BaseException` in readers, finalizers, callbacks from
native code), and it turns into other errors, such as the ImportError of a half-imported package. There a thread of its
own waits for signals, does the acts that are pending, and ends the process, whatever the main thread is doing.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

Act = Callable[[], object]

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # the last one comes when a terminal is closed; Windows lacks it
_PATIENCE = 3.0  # seconds for what is being written, and again for the acts; a pipe that nobody reads blocks both
_writing = threading.RLock()
_acts: list[Act] = []


@contextmanager
def written_whole() -> Iterator[None]:
    """While the block writes, no signal ends the process: it waits until the block is left."""
    with _writing:
        yield


@contextmanager
def finally_do(act: Act) -> Iterator[None]:
    """Do something when the block is left, once, also if a signal ends the process meanwhile.

    Args:
        act: must be safe to call from another thread while the main thread is anywhere in the block, except in a block
            of `written_whole`.
    """
    _acts.append(act)
    try:
        yield
    finally:
        with _writing:
            _acts.remove(act)
            act()


def end_on_signals() -> None:
    """Let SIGINT, SIGTERM and SIGHUP end this process with exit code 128 + number, for the command line alone.

    What is being written is finished and the pending acts of `finally_do` are done first, for a few seconds at most; a
    second signal ends the process at once. Signals that the caller has set to be ignored, as `nohup` and shells do for
    jobs in the background, stay ignored.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    numbers = [getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)]
    taken = [number for number in numbers if signal.getsignal(number) not in (signal.SIG_IGN, None)]
    threading.Thread(target=_wait, args=(reader, taken), name="signals", daemon=True).start()
    for number in taken:
        signal.signal(number, lambda *_: None)  # only a handler of Python's wakes the thread


def leave(code: int, message: str) -> None:
    """Do the pending acts, print a message on standard error, and end the process from any thread.

    Args:
        code: exit code.
        message: one line.
    """
    _soon(code, message)
    _writing.acquire(timeout=_PATIENCE)
    try:
        with ExitStack() as stack:
            for act in _acts:
                stack.callback(act)  # the latest first, and all of them, even if one fails
    finally:
        _exit(code, message)


def _wait(reader: int, taken: list[int]) -> None:
    """Wait for a signal, then end; and for a second one, then end at once."""
    number = _next(reader, taken)
    what, code = f"ended by {signal.Signals(number).name}", 128 + number
    message = f"{what}; results that were written are whole."
    threading.Thread(target=leave, args=(code, message), daemon=True).start()
    _next(reader, taken)
    _exit(code, f"{what}, twice: the last result may not be whole.")


def _next(reader: int, taken: list[int]) -> int:
    while (number := os.read(reader, 1)[0]) not in taken:
        pass
    return number


def _soon(code: int, message: str) -> None:
    """End the process after twice the patience, if nothing else does."""
    timer = threading.Timer(2 * _PATIENCE, _exit, (code, message))
    timer.daemon = True
    timer.start()


def _exit(code: int, message: str) -> None:
    with suppress(OSError):
        os.write(2, f"topokit: {message}\n".encode())  # not sys.stderr, whose lock the main thread may hold
    os._exit(code)
