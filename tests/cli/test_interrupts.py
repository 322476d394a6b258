"""Signals at a few random moments of the command; `benchmarks/interrupts.py` sends hundreds."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks.interrupts import BEFORE, FINE, disturbed, moments, undisturbed, write_runs

pytestmark = [pytest.mark.long, pytest.mark.skipif(sys.platform == "win32", reason="processes cannot be sent signals")]
NAMES = ("mesh", "points", "folder, 2 jobs", "colors")


def test_signals_end_the_command_cleanly_at_any_moment(tmp_path: Path) -> None:
    runs = [run for run in write_runs(tmp_path) if run.name in NAMES]
    seconds = {run.name: undisturbed(run) for run in runs}
    found = [
        disturbed(run, number, share * seconds[run.name])[0] for run, number, share in moments(runs, 2 * len(runs), 0)
    ]
    assert set(found) <= FINE
    assert found.count(BEFORE) < len(found) / 2
