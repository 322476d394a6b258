"""A line on stderr while a network is being evaluated, where somebody is looking and has waited a while."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from topokit.adapters.implicit.function import LevelFunction
from topokit.core.implicit.adaptive_grid import FieldGrid

_PATIENCE = 3.0  # seconds before anything is shown
_WIDTH = 24


@contextmanager
def progress(function: LevelFunction, finest: int) -> Iterator[Callable[[FieldGrid], None]]:
    """Show how far the grids up to `finest` cells have come, while their evaluations run.

    The work is guessed from the last grid: halving the step takes about four times as many evaluations.
    """
    if not sys.stderr.isatty():
        yield lambda grid: None
        return
    started, state = time.perf_counter(), {"start": 0, "expected": 0, "cells": 0}
    ask = function.f

    def shown(points):  # type: ignore[no-untyped-def]
        if time.perf_counter() - started > _PATIENCE and state["expected"]:
            share = min(1.0, (function.n_evaluations - state["start"]) / state["expected"])
            bar = ("█" * round(share * _WIDTH)).ljust(_WIDTH, "░")
            sys.stderr.write(f"\r{function.name}: grid of {2 * state['cells']} cells (last: {finest}) {bar}")
            sys.stderr.flush()
        return ask(points)

    def advance(grid: FieldGrid) -> None:
        done = function.n_evaluations
        state.update(start=done, expected=4 * max(done - state["start"], 1), cells=grid.n_cells)

    function.f = shown
    try:
        yield advance
    finally:
        function.f = ask
        sys.stderr.write("\r\x1b[K")
