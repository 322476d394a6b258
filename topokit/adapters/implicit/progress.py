"""A progress bar for the evaluation of networks: on terminals and in notebooks, after three seconds."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from topokit.core.grid.grid import Grid
from topokit.core.implicit.adaptive_grid import Progress, no_progress
from topokit.text import printable

_PATIENCE = 3.0  # seconds before anything is shown


@contextmanager
def progress_bar(name: str, finest: int) -> Iterator[Progress]:
    """What to call after each block of points; the bar disappears at the end.

    Args:
        name: of the function.
        finest: cells along the longest side of the last grid.
    """
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    if not (console.is_interactive or console.is_jupyter):  # rich leaves out terminals that cannot draw
        yield no_progress
        return
    started = time.perf_counter()
    bar = Bar(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        console=console,
        transient=True,
    )
    name = printable(name)
    task = bar.add_task(name)

    def show(grid: Grid, done: int, total: int) -> None:
        bar.update(
            task, description=f"{name}: grid of {grid.n_cells} cells (last: {finest})", completed=done, total=total
        )
        if time.perf_counter() - started > _PATIENCE:
            bar.start()

    try:
        yield show
    finally:
        bar.stop()
