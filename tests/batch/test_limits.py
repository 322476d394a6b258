"""Limits on time and memory of tasks; `tests/cli/test_process.py` has files that exceed one."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

import topokit as tk
from topokit.batch import processes
from topokit.batch.limits import NO_LIMITS, Limits, memory_of
from topokit.batch.processes import map_in_processes

HOG = "bytearray(b'x') * (1 << 28)"  # touches a quarter of a GiB, slowly enough to be seen


@pytest.fixture
def no_warm_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes import nothing before their first task, which takes seconds in each."""
    monkeypatch.setattr(processes, "import_what_is_needed", bool)


def after_death(task: object, how: str) -> str:
    return f"{task}: {how}"


def results(numbered: Iterable[tuple[int, Any]]) -> list[Any]:
    """Those of one process, which come in the order of the tasks."""
    numbers, found = zip(*numbered, strict=True)
    assert numbers == tuple(range(len(numbers)))
    return list(found)


@pytest.mark.usefixtures("no_warm_up")
def test_a_task_that_takes_too_long_is_ended() -> None:
    started = time.monotonic()
    found = results(map_in_processes(time.sleep, [0.0, 300.0, 0.0], 1, after_death, Limits(seconds=1)))
    assert found == [None, "300.0: it took longer than the time limit of 1 s", None]
    assert time.monotonic() - started < 200


@pytest.mark.usefixtures("no_warm_up")
def test_the_time_to_read_an_answer_is_not_the_task_s() -> None:
    slow_to_read = "type('Slow', (), {'__reduce__': lambda self: (__import__('time').sleep, (3,))})()"
    found = results(map_in_processes(eval, [slow_to_read, "2 + 2"], 1, after_death, Limits(seconds=2)))
    assert found == [None, 4]


@pytest.mark.usefixtures("no_warm_up")
def test_a_task_that_fills_memory_is_ended() -> None:
    tasks = ["1 + 1", f"len([{HOG} for _ in range(64)])", "2 + 2"]
    found = results(map_in_processes(eval, tasks, 1, after_death, Limits(gibibytes=0.5)))
    assert found[::2] == [2, 4]
    assert str(found[1]).endswith("it needed more than the memory limit of 0.5 GiB")


@pytest.mark.usefixtures("no_warm_up")
def test_a_process_that_keeps_memory_is_replaced() -> None:
    keep = f"(globals().update(kept={HOG}), __import__('os').getpid())[1]"
    process = "__import__('os').getpid()"
    found = results(map_in_processes(eval, [process, keep, process], 1, after_death, Limits(gibibytes=0.4)))
    assert found[0] == found[1] != found[2]


def test_a_survey_checks_its_limits(tmp_path: Path) -> None:
    with pytest.raises(tk.InputError, match="time_limit must be positive, not 0"):
        tk.survey(tmp_path, time_limit=0)


def test_no_limits_are_none() -> None:
    assert not NO_LIMITS
    assert Limits(seconds=1)
    assert memory_of(2**22 + 1) == 0
