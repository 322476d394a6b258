"""A bar for a cloud that takes long: stage, time taken and time left, on terminals and in notebooks."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer

from topokit.core.progress import listening

_PATIENCE = 3.0  # seconds before anything is shown
_FEWEST = 3_000  # points that may take so long


@contextmanager
def stage_bar(n_points: int) -> Iterator[None]:
    """Show the stages of the block on standard error, if it can draw; the bar disappears at the end.

    Args:
        n_points: of the cloud; nothing is shown for few.
    """
    if n_points < _FEWEST:
        yield
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not (console.is_interactive or console.is_jupyter):  # rich leaves out terminals that cannot draw
        yield
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn(), "{task.fields[left]}")
    bar = Progress(*columns, console=console, transient=True, redirect_stdout=False)
    name = f"{n_points} points"
    task = bar.add_task(name, total=1.0, left="")
    started = time.perf_counter()

    def show(stage: str, share: float) -> None:
        left = time_left(time.perf_counter() - started, share)
        bar.update(task, description=f"{name}: {stage}", completed=share, left=left)

    timer = Timer(_PATIENCE, bar.start)
    timer.daemon = True
    timer.start()
    try:
        with listening(show):
            yield
    finally:
        timer.cancel()
        bar.stop()


def time_left(seconds: float, share: float) -> str:
    """About how long the rest takes, by the seconds that a share of the whole took; nothing if that is none."""
    if share == 0:
        return ""
    left = seconds * (1 - share) / share
    return f"about {left:.0f} s left" if left < 90 else f"about {left / 60:.0f} min left"
