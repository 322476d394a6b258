"""`topokit report` that goes on with a run that was stopped, and on a cluster."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from topokit.cli.app import app

DATA = Path(__file__).resolve().parents[1] / "data"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "files").mkdir()
    for number in range(40):
        shutil.copy(DATA / "sphere.ply", tmp_path / "files" / f"{number:02}.ply")
    return tmp_path / "files"


def files_in(rows: Path) -> list[str]:
    return [json.loads(line)["file"] for line in rows.read_text().splitlines()]


def test_a_killed_run_goes_on_where_it_was(folder: Path, tmp_path: Path) -> None:
    rows = tmp_path / "rows.jsonl"
    options = ["report", str(folder), "--jsonl", "-o", str(rows), "--resume"]
    with subprocess.Popen([sys.executable, "-m", "topokit", *options], stderr=subprocess.DEVNULL) as process:
        while process.poll() is None and (not rows.exists() or rows.read_bytes().count(b"\n") < 3):
            time.sleep(0.02)
        os.kill(process.pid, signal.SIGKILL)
    known = rows.read_bytes()
    kept = known[: known.rindex(b"\n") + 1]
    ran = CliRunner().invoke(app, options)
    assert ran.exit_code == 0, ran.output
    assert f"{kept.count(chr(10).encode())} files of 40 were examined before" in ran.stderr
    assert rows.read_bytes().startswith(kept)
    assert files_in(rows) == [str(folder / f"{number:02}.ply") for number in range(40)]


def test_a_failure_before_the_stop_counts(tmp_path: Path) -> None:
    shutil.copy(DATA / "truncated.stl", tmp_path)
    options = ["report", str(tmp_path / "truncated.stl"), "--jsonl", "-o", str(tmp_path / "rows.jsonl"), "--resume"]
    first, again = (CliRunner().invoke(app, options) for _ in range(2))
    assert (first.exit_code, again.exit_code) == (1, 1)
    assert "--retry-failed" not in first.stderr
    assert "1 of them failed; add --retry-failed" in again.stderr
    retried = CliRunner().invoke(app, [*options, "--retry-failed"])
    assert (retried.exit_code, "truncated.stl" in retried.stderr) == (1, True)
    shutil.copy(DATA / "torus.stl", tmp_path / "truncated.stl")
    assert CliRunner().invoke(app, options).exit_code == 0  # the file was replaced
    assert len(files_in(tmp_path / "rows.jsonl")) == 1


def test_other_options_are_wrong_usage(tmp_path: Path) -> None:
    options = ["report", str(DATA / "torus.stl"), "--jsonl", "-o", str(tmp_path / "rows.jsonl")]
    assert CliRunner().invoke(app, [*options, "--samples", "500"]).exit_code == 0
    assert json.loads((tmp_path / "rows.jsonl").read_text())["options"] == {"n_samples": 500}
    ran = CliRunner().invoke(app, [*options, "--resume", "--samples", "600"])
    assert ran.exit_code == 2
    assert "was examined with the options" in ran.stderr
    assert CliRunner().invoke(app, [*options, "--resume", "--samples", "500"]).exit_code == 0
    assert len(files_in(tmp_path / "rows.jsonl")) == 1


def test_retrying_without_resuming_is_wrong_usage(folder: Path) -> None:
    ran = CliRunner().invoke(app, ["report", str(folder), "--retry-failed"])
    assert (ran.exit_code, "--retry-failed goes with --resume" in ran.stderr) == (2, True)


@pytest.mark.parametrize("more", [[], ["-o", "x.jsonl"], ["--jsonl"], ["--jsonl", "-o", "x", "--fail-on", "open"]])
def test_what_cannot_be_resumed_is_wrong_usage(folder: Path, more: list[str]) -> None:
    ran = CliRunner().invoke(app, ["report", str(folder), "--resume", *more])
    assert ran.exit_code == 2
    assert "--resume goes with -o and --jsonl" in ran.stderr.replace("\n", " ")


@pytest.mark.long
def test_a_local_cluster_gives_every_row_once(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    rows = tmp_path / "rows.jsonl"
    command = [
        sys.executable,
        "-m",
        "topokit",
        "report",
        folder,
        "--jsonl",
        "-o",
        rows,
        "--cluster",
        "local",
        "-j",
        "2",
    ]
    ran = subprocess.run(command, capture_output=True, text=True)
    assert (ran.returncode, ran.stdout) == (0, ""), ran.stderr
    assert sorted(files_in(rows)) == [str(folder / f"{number:02}.ply") for number in range(40)]


def test_an_address_without_scheduler_is_wrong_usage(folder: Path) -> None:
    pytest.importorskip("distributed")
    ran = CliRunner().invoke(app, ["report", str(folder), "--cluster", "nonsense://x"])
    assert ran.exit_code == 2
    assert "no scheduler answers" in ran.stderr
