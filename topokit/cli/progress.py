"""Progress on a terminal: what is examined, how many are done, the time taken and left; elsewhere nothing."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from topokit.ending import finally_do

if TYPE_CHECKING:
    from rich.progress import Progress

_NAME_SHARE = 4  # a file's name takes at most one part in so many of the terminal's width
_NO_OTHER_BARS = "TTY_INTERACTIVE"  # rich's variable; "0" keeps other consoles from drawing


class Bar:
    """A bar on standard error, or nothing."""

    def __init__(self, names: Sequence[str], bar: Progress | None) -> None:
        """Args: names of all files in order; the bar to draw on."""
        self._names, self._bar = names, bar
        self._n_done = 0
        if bar is not None:
            bar.add_task("", total=len(names) if len(names) > 1 else None)
            self._show_state()
            bar.start()

    def advance(self) -> None:
        """One more file is done."""
        self._n_done += 1
        self._show_state()

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
            name = self._names[min(self._n_done, len(self._names) - 1)]
            width = self._bar.console.width // _NAME_SHARE
            shown = name if len(name) <= width else "…" + name[1 - width :]
            self._bar.update(self._bar.task_ids[0], completed=self._n_done, description=shown)


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
    if len(names) > 1:
        columns += [MofNCompleteColumn(), TimeRemainingColumn()]
    bar = Progress(*columns, console=console, transient=True, redirect_stdout=False)
    before = os.environ.get(_NO_OTHER_BARS)
    if console.is_interactive:
        os.environ[_NO_OTHER_BARS] = "0"
    try:
        with finally_do(bar.stop):
            yield Bar(names, bar if console.is_interactive else None)
    finally:
        if before is None:
            os.environ.pop(_NO_OTHER_BARS, None)
        else:
            os.environ[_NO_OTHER_BARS] = before
