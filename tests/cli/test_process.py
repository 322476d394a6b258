"""The command as a process: a pipe that closes, an interrupt, several processes, a terminal."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from interrupts import accept_interrupts
from typer.testing import CliRunner

from topokit.cli.app import app

DATA = Path(__file__).resolve().parents[1] / "data"
TOPOKIT = [sys.executable, "-m", "topokit"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Many copies of a sphere and a broken file."""
    for number in range(30):
        shutil.copy(DATA / "sphere.ply", tmp_path / f"{number:02}.ply")
    shutil.copy(DATA / "truncated.stl", tmp_path / "99.stl")
    return tmp_path


@pytest.mark.parametrize("jobs", ["1", pytest.param("2", marks=pytest.mark.long)])
def test_a_pipe_that_closes_ends_quietly(folder: Path, jobs: str) -> None:
    command = [*TOPOKIT, "report", folder, "--jsonl", "--jobs", jobs]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        first = json.loads(process.stdout.readline())
        process.stdout.close()
        assert (process.stderr.read(), process.wait(timeout=120)) == (b"", 1)
    assert first["euler"] == 2


@pytest.mark.parametrize("jobs", ["1", pytest.param("2", marks=pytest.mark.long)])
def test_an_interrupt_ends_with_130_and_leaves_whole_results(folder: Path, jobs: str) -> None:
    files = [folder] * 40
    command = [*TOPOKIT, "report", *files, "--json", "--jobs", jobs]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=accept_interrupts,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        beginning = b"".join(process.stdout.readline() for _ in range(500))
        os.killpg(process.pid, signal.SIGINT)
        rest, errors = process.stdout.read(), process.stderr.read()
    assert process.returncode == 130
    assert b"Traceback" not in errors
    assert len(json.loads(beginning + rest)) >= 5


def on_a_terminal(*arguments: object, columns: int) -> tuple[int, str]:
    """Exit code of the command on a terminal, and all that it wrote there."""
    import pty  # exists where there are such terminals
    import termios

    terminal, its_side = pty.openpty()
    termios.tcsetwinsize(its_side, (24, columns))
    inherited = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
    variables = {**inherited, "TERM": "xterm-256color"}
    command = [*TOPOKIT, *map(str, arguments)]
    process = subprocess.Popen(command, stdin=its_side, stdout=its_side, stderr=its_side, env=variables)
    os.close(its_side)
    written = b""
    try:
        while part := os.read(terminal, 1 << 16):
            written += part
    except OSError:  # how a terminal says that nobody writes any more
        pass
    os.close(terminal)
    return process.wait(timeout=120), written.decode()


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such terminals")
def test_a_terminal_shows_a_table_and_the_progress(folder: Path) -> None:
    started = time.perf_counter()
    code, written = on_a_terminal("report", folder, columns=50)
    assert code == 1
    assert time.perf_counter() - started < 240
    assert "\x1b[32mcertain\x1b[0m" in written
    assert "0/31" in written
    assert "failed" in written
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", written).replace("\r", "\n")
    rows = [line for line in plain.splitlines() if re.search(r"\.ply +certain", line)]
    assert len(rows) == 30
    assert max(map(len, rows)) <= 50


@pytest.mark.skipif(sys.platform == "win32", reason="processes cannot be sent this signal")
def test_a_terminated_command_keeps_its_rows_and_ends_its_processes(folder: Path) -> None:
    command = [*TOPOKIT, "report", *[folder] * 40, "--jsonl", "--jobs", "2"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        first = process.stdout.readline()
        workers = psutil.Process(process.pid).children()
        process.terminate()
        rest, errors = process.stdout.read(), process.stderr.read().decode()
    assert process.returncode == 143
    assert errors.splitlines()[-1] == "topokit: ended by SIGTERM; results that were written are whole."
    assert all(json.loads(line) for line in (first + rest).splitlines())
    assert len(workers) == 2
    assert not psutil.wait_procs(workers, timeout=30)[1]


def test_limits_of_two_processes_cost_a_row_and_their_values_are_checked(folder: Path) -> None:
    (folder / "50.xyz").write_text("\n".join(f"{n % 97} {n % 89} {n % 83}" for n in range(100_000)))
    options = ["report", *(str(folder / name) for name in ("00.ply", "50.xyz", "01.ply")), "--csv"]
    found = CliRunner().invoke(app, [*options, "--time-limit", "1", "--jobs", "2"])
    rows = list(csv.DictReader(found.stdout.splitlines()))
    assert found.exit_code == 1
    assert [row["verdict"] for row in rows] == ["certain", "", "certain"]  # in the order of the files
    assert f"{folder / '50.xyz'}: it took longer than the time limit of 1 s." in found.stderr
    assert CliRunner().invoke(app, [*options, "--memory-limit", "0"]).exit_code == 2


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is always full")
@pytest.mark.parametrize(
    "arguments",
    [(), *(pytest.param(more, marks=pytest.mark.long) for more in (("--jsonl", "-o", "/dev/full"), ("--json",)))],
)
def test_a_full_disk_is_a_clear_error(arguments: tuple[str, ...]) -> None:
    command = [*TOPOKIT, "report", str(DATA / "sphere.ply"), *arguments]
    with open("/dev/full", "w") as full:
        found = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=120)
    assert found.returncode == 1
    assert found.stderr == "topokit: results could not be written (No space left on device).\n"
