"""A bar for what takes long: what is done, the time taken and left, on terminals and in notebooks."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from threading import Timer
from typing import TYPE_CHECKING, TypeVar

from topokit.core.progress import has_listener, listening
from topokit.ending import finally_do
from topokit.text import printable

if TYPE_CHECKING:
    from rich.progress import Progress

Result = TypeVar("Result")

_PATIENCE = 3.0  # seconds before anything is shown
_NAME_SHARE = 4  # a name takes at most one part in so many of the terminal's width


class Bar:
    """A bar on standard error, or nothing."""

    def __init__(self, names: Sequence[str], bar: Progress | None) -> None:
        """Args: names of all that is examined, in order; the bar to draw on, or None."""
        self._names, self._bar = names, bar
        self._n_done = 0
        self._started = time.perf_counter()
        if bar is not None:
            bar.add_task("", total=len(names) if len(names) > 1 else None, left="")
            self._show_count()

    def counting(self, results: Iterable[Result]) -> Iterator[Result]:
        """The results of all that is examined, as they come; one more is done with each."""
        for result in results:
            yield result
            self._n_done += 1
            self._show_count()

    def show_stage(self, stage: str, share: float) -> None:
        """A `Listener`: while one thing is examined its stages are shown, of several the number that are done."""
        if self._bar is not None and len(self._names) == 1:
            left = time_left(time.perf_counter() - self._started, share)
            description = f"{self._shown_name()}: {stage}"
            self._bar.update(self._bar.task_ids[0], description=description, total=1.0, completed=share, left=left)

    @contextmanager
    def hidden(self) -> Iterator[None]:
        """Take the bar off the terminal while something is written there."""
        if self._bar is None:
            yield
            return
        self._bar.stop()
        try:
            yield
        finally:
            self._bar.start()

    def _show_count(self) -> None:
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=self._n_done, description=self._shown_name())

    def _shown_name(self) -> str:
        assert self._bar is not None
        name = printable(self._names[min(self._n_done, len(self._names) - 1)])
        width = self._bar.console.width // _NAME_SHARE
        return name if len(name) <= width else "…" + name[1 - width :]


@contextmanager
def progress_bar(names: Sequence[str], patience: float | None = None) -> Iterator[Bar]:
    """A bar for the time of the block, if standard error can draw; it listens to the stages that begin in the block.

    There is one bar at a time: where there is a listener already, no other is drawn.

    Args:
        names: of what is examined, in order; none for no bar.
        patience: seconds before it is shown; three by default.
    """
    bar = None if not names or has_listener() else _drawn(len(names) > 1)
    shown = Bar(names, bar)
    if bar is None:
        yield shown
        return
    wait = _PATIENCE if patience is None else patience
    timer = Timer(wait, bar.start)
    timer.daemon = True
    with finally_do(bar.stop), finally_do(timer.cancel), listening(shown.show_stage):
        timer.start() if wait else bar.start()
        yield shown


def _drawn(many: bool) -> Progress | None:
    """A bar that disappears at the end, or None if standard error is no terminal or notebook that can draw."""
    from rich import progress as parts
    from rich.console import Console

    console = Console(stderr=True)
    if not (console.is_interactive or console.is_jupyter):
        return None
    left = (
        (parts.MofNCompleteColumn(), parts.TimeRemainingColumn())
        if many
        else (parts.TextColumn("{task.fields[left]}"),)
    )
    columns = (parts.TextColumn("{task.description}", markup=False), parts.BarColumn(), parts.TimeElapsedColumn())
    return parts.Progress(*columns, *left, console=console, transient=True, redirect_stdout=False)


def time_left(seconds: float, share: float) -> str:
    """About how long the rest takes, by the seconds that a share of the whole took; nothing if that is none or all."""
    if share in (0, 1):
        return ""
    left = seconds * (1 - share) / share
    return f"about {left:.0f} s left" if left < 90 else f"about {left / 60:.0f} min left"
