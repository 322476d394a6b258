"""Progress on a terminal: what is examined, how much of it is done, the time taken and left; elsewhere nothing."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, TypeVar

from topokit.core.progress import listening
from topokit.ending import finally_do
from topokit.report.progress import time_left
from topokit.text import printable

if TYPE_CHECKING:
    from rich.progress import Progress

Result = TypeVar("Result")

_NAME_SHARE = 4  # a file's name takes at most one part in so many of the terminal's width
_NO_OTHER_BARS = "TTY_INTERACTIVE"  # rich's variable; "0" keeps other consoles from drawing


class Bar:
    """A bar on standard error, or nothing."""

    def __init__(self, names: Sequence[str], bar: Progress | None) -> None:
        """Args: names of all files in order; the bar to draw on."""
        self._names, self._bar = names, bar
        self._n_done = 0
        self._started = time.perf_counter()
        if bar is not None:
            bar.add_task("", total=len(names) if len(names) > 1 else None, left="")
            self._show_state()
            bar.start()

    def counting(self, results: Iterable[Result]) -> Iterator[Result]:
        """The results of files, as they come; one more is done with each."""
        for result in results:
            yield result
            self._n_done += 1
            self._show_state()

    def show_stage(self, stage: str, share: float) -> None:
        """Of a single file a stage begins, when a share of the work is done."""
        if self._bar is not None:
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

    def _show_state(self) -> None:
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=self._n_done, description=self._shown_name())

    def _shown_name(self) -> str:
        assert self._bar is not None
        name = printable(self._names[min(self._n_done, len(self._names) - 1)])
        width = self._bar.console.width // _NAME_SHARE
        return name if len(name) <= width else "…" + name[1 - width :]


@contextmanager
def progress_bar(names: Sequence[str]) -> Iterator[Bar]:
    """A bar for the time of the block, if standard error is a terminal that can draw and there are names.

    Args:
        names: of the files, in order; none for no bar.
    """
    if not names or not sys.stderr.isatty():
        yield Bar(names, None)
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = [TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn()]
    columns += [MofNCompleteColumn(), TimeRemainingColumn()] if len(names) > 1 else [TextColumn("{task.fields[left]}")]
    bar = Progress(*columns, console=console, transient=True, redirect_stdout=False)
    before = os.environ.get(_NO_OTHER_BARS)
    if console.is_interactive:
        os.environ[_NO_OTHER_BARS] = "0"
    try:
        shown = Bar(names, bar if console.is_interactive else None)
        with finally_do(bar.stop), listening(shown.show_stage) if len(names) == 1 else nullcontext():
            yield shown
    finally:
        if before is None:
            os.environ.pop(_NO_OTHER_BARS, None)
        else:
            os.environ[_NO_OTHER_BARS] = before
