"""Tasks in several processes: results as they are known, deaths, and an early end."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
from itertools import islice
from pathlib import Path

import pytest

from topokit.batch import processes
from topokit.batch.processes import map_in_processes


def after_death(task: float, how: str) -> str:
    return f"{task} died: {how}"


def test_results_come_as_they_are_known() -> None:
    coming = map_in_processes(time.sleep, [2.0, 0.0, 0.0], 2, after_death)
    assert [number for number, _ in coming] == [1, 2, 0]
    words = [f"word {n}" for n in range(40)]
    assert dict(map_in_processes(str.upper, words, 3, after_death)) == dict(enumerate(map(str.upper, words)))


def test_a_process_that_dies_costs_one_result() -> None:
    signals = [signal.SIGWINCH, signal.SIGSEGV, signal.SIGWINCH]
    found = dict(map_in_processes(signal.raise_signal, signals, 2, after_death))
    assert (found[0], found[2]) == (None, None)
    assert str(found[1]).endswith("its process died (SIGSEGV, Segmentation fault)")
    found = dict(map_in_processes(os._exit, [3], 1, after_death))
    assert found == {0: "3 died: its process died (exit code 3)"}
    found = dict(map_in_processes(signal.raise_signal, [signal.SIGKILL], 1, after_death))
    assert "SIGKILL, Killed: perhaps the memory was used up" in str(found[0])


def test_an_exception_in_a_process_is_named() -> None:
    found = dict(map_in_processes(int, ["1", "\udcff", "2"], 2, after_death))  # type: ignore[arg-type]
    assert (found[0], found[2]) == (1, 2)
    assert "ValueError: invalid literal for int() with base 10" in str(found[1])


def test_what_a_function_prints_does_not_disturb(capfd: pytest.CaptureFixture[str]) -> None:
    assert list(map_in_processes(os.system, ["echo noise"], 1, after_death)) == [(0, 0)]
    found = capfd.readouterr()
    assert (found.out, found.err) == ("", "noise\n")


def test_processes_end_with_the_iterator() -> None:
    started = time.perf_counter()
    coming = map_in_processes(time.sleep, [0.0, 100.0, 100.0], 2, after_death)
    assert next(coming) == (0, None)
    coming.close()
    assert time.perf_counter() - started < 60
    with pytest.raises(StopIteration):
        next(coming)


def test_temporary_files_of_processes_are_removed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    make = "(__import__('tempfile').mkdtemp(), __import__('time').sleep(1000 * {}))[0]"
    coming = map_in_processes(eval, [make.format(0), make.format(1)], 2, after_death)
    assert Path(next(coming)[1]).parent.parent == tmp_path
    coming.close()
    assert not list(tmp_path.iterdir())


def test_few_tasks_are_taken_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "_AHEAD", 3)
    taken = []

    def tasks() -> object:
        for n in range(100):
            taken.append(n)
            yield str(n)

    coming = map_in_processes(str.upper, tasks(), 2, after_death)  # type: ignore[arg-type]
    assert len(list(islice(coming, 2))) == 2
    assert len(taken) <= 5
    coming.close()


def test_threads_are_shared_among_the_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in processes._THREADS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(processes, "n_cores", lambda: 8)
    found = dict(map_in_processes(os.getenv, ["OMP_NUM_THREADS"] * 3, 4, after_death))
    assert found == dict.fromkeys(range(3), "2")
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert list(map_in_processes(os.getenv, ["OMP_NUM_THREADS"], 4, after_death)) == [(0, "7")]


def test_a_script_needs_no_guard() -> None:
    script = (
        "from topokit.batch.processes import map_in_processes\n"
        "print(sorted(map_in_processes(str.upper, ['a', 'b'], 2, None)))\n"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=100)
    assert (ran.stdout, ran.stderr) == ("[(0, 'A'), (1, 'B')]\n", "")


@pytest.mark.skipif(sys.platform == "win32", reason="a closed pipe is another error there")
def test_a_process_whose_parent_has_ended_says_nothing() -> None:
    command = [sys.executable, "-c", "from topokit.batch.worker_process import main; main()"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe) as worker:
        assert worker.stdin is not None
        assert worker.stdout is not None
        assert worker.stderr is not None
        worker.stdout.close()
        worker.stdin.write(pickle.dumps((str.upper, "word")))
        worker.stdin.flush()
        assert worker.stderr.read() == b""
    assert worker.returncode == 1
