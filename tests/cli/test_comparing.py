"""The command `topokit compare`: two files, two folders, labels, and the exit code."""

from __future__ import annotations

import csv
import io
import json
import os

import numpy as np
import pytest
from typer.testing import CliRunner

from topokit.cli.app import app


@pytest.fixture
def folders(tmp_path):
    ring = np.zeros((9, 9, 4), np.uint8)
    ring[1:8, 1:8, 1:3] = 1
    ring[4, 4] = 0
    for folder in ("pred", "truth"):
        (tmp_path / folder).mkdir()
        np.save(tmp_path / folder / "same.npy", ring)
    np.save(tmp_path / "truth" / "filled.npy", ring)
    ring[4, 4, 1:3] = 1
    np.save(tmp_path / "pred" / "filled.npy", ring)
    return tmp_path


def run(*arguments: object):
    return CliRunner().invoke(app, ["compare", *map(str, arguments)])


def test_two_files_in_words(folders) -> None:
    found = run(folders / "pred" / "filled.npy", folders / "truth" / "filled.npy")
    assert found.exit_code == 0
    prediction, truth = (os.path.join(folder, "filled.npy") for folder in ("pred", "truth"))
    assert found.stdout.startswith(f"{prediction} against {truth}: parts 1 matched, 0 missing, 0 spurious; tunnels 0 ")
    assert "  - missing filled tunnel at voxel (4, 4, 2)" in found.stdout


def test_folders_as_csv_and_json_with_a_condition(folders) -> None:
    found = run(folders / "pred", folders / "truth", "--csv", "--fail-on", "missing1>0")
    rows = list(csv.DictReader(io.StringIO(found.stdout)))
    assert [(row["file"], row["missing1"], row["error"]) for row in rows] == [("filled", "1", ""), ("same", "0", "")]
    assert rows[1]["dice"] == "1.0"
    assert (found.exit_code, found.stderr) == (1, "topokit: filled meets missing1>0 (1)\n")
    records = json.loads(run(folders / "pred", folders / "truth", "--json").stdout)
    assert records[0]["features"][0]["kind"] == "filled tunnel"
    assert records[1]["missing"] == [0, 0, 0]


def test_labels_and_what_is_ignored(folders) -> None:
    found = run(folders / "pred", folders / "truth", "--csv", "--labels", "all", "--ignore", "0")
    rows = list(csv.DictReader(io.StringIO(found.stdout)))
    assert [(row["file"], row["label"], row["missing1"]) for row in rows] == [("filled", "1", "0"), ("same", "1", "0")]


def test_betti_matching_on_the_command_line(folders) -> None:
    pairs = folders / "pred", folders / "truth"
    found = run(*pairs, "--csv", "--matching", "betti-matching")
    assert [row["missing1"] for row in csv.DictReader(io.StringIO(found.stdout))] == ["1", "0"]
    refused = run(*pairs, "--matching", "betti-matching", "--connectivity", "26")
    assert (refused.exit_code, "pass --connectivity 6" in refused.stderr) == (1, True)


def test_a_file_without_partner_and_wrong_usage(folders) -> None:
    (folders / "truth" / "same.npy").unlink()
    found = run(folders / "pred", folders / "truth", "--csv")
    assert found.exit_code == 1
    assert "has no file of this name" in found.stdout
    assert run(folders / "pred", folders / "truth", "--fail-on", "genus>0").exit_code == 2
    assert run(folders / "pred", folders / "truth", "--labels", "one").exit_code == 2
    np.save(folders / "pred" / "gray.npy", np.random.default_rng(0).random((9, 9, 4)))
    gray = run(folders / "pred" / "gray.npy", folders / "truth" / "filled.npy")
    assert (gray.exit_code, "pass --level" in gray.stderr) == (1, True)


def test_several_processes_give_the_same_rows_and_page(folders) -> None:
    (folders / "truth" / "only.npy").write_bytes(b"no array")
    (folders / "pred" / "only.npy").write_bytes(b"no array")
    pairs = folders / "pred", folders / "truth"
    alone, shared = (
        run(*pairs, "--csv", "--jobs", jobs, "--html", folders / f"{jobs}.html", "--fail-on", "missing1>0")
        for jobs in (1, 2)
    )
    rows = [list(csv.DictReader(io.StringIO(one.stdout))) for one in (alone, shared)]
    times = [[row.pop("seconds") for row in one] for one in rows]
    assert rows[0] == rows[1]
    assert [row["file"] for row in rows[1]] == ["filled", "only", "same"]
    assert all(float(seconds) >= 0 for one in times for seconds in one)
    assert rows[1][1]["error"].startswith("only: ")
    assert (alone.exit_code, shared.exit_code, alone.stderr) == (1, 1, shared.stderr)
    assert "topokit: filled meets missing1>0 (1)\n" in shared.stderr
    page = (folders / "2.html").read_text(encoding="utf-8")
    assert "missing filled tunnel" in page
    assert "pred against truth" in page


@pytest.mark.long
def test_a_process_that_exceeds_its_memory_costs_one_row(folders) -> None:
    huge = np.zeros((400, 400, 400), np.uint8)
    huge[100:300, 100:300, 100:300] = 1
    for folder in ("pred", "truth"):
        np.save(folders / folder / "huge.npy", huge)
    found = run(folders / "pred", folders / "truth", "--csv", "--memory-limit", "0.7")
    rows = {row["file"]: row for row in csv.DictReader(io.StringIO(found.stdout))}
    assert rows["huge"]["error"] == "huge: it needed more than the memory limit of 0.7 GiB."
    assert (rows["same"]["matched1"], rows["filled"]["missing1"], found.exit_code) == ("1", "1", 1)


def test_a_run_that_was_stopped_goes_on(folders) -> None:
    lines = folders / "lines.jsonl"
    arguments = [folders / "pred", folders / "truth", "--jsonl", "-o", lines, "--resume", "--fail-on", "missing1>0"]
    assert run(*arguments).exit_code == 1
    whole = lines.read_text().splitlines(keepends=True)
    assert [json.loads(line)["file"] for line in whole] == ["filled", "same"]
    lines.write_text(whole[0] + whole[1][:40])  # killed while it wrote the second one
    again = run(*arguments)
    assert "1 file of 2 was examined before" in again.stderr
    assert "filled meets missing1>0 (1)" in again.stderr  # what an earlier run found counts
    assert (again.exit_code, lines.read_text().splitlines(keepends=True)[0]) == (1, whole[0])
    assert [json.loads(line)["file"] for line in lines.read_text().splitlines()] == ["filled", "same"]
    np.save(folders / "truth" / "filled.npy", np.load(folders / "pred" / "filled.npy"))  # another truth
    mended = run(*arguments)
    assert "1 file is examined again" in mended.stderr
    assert mended.exit_code == 0
    other = run(*arguments, "--level", "0.5")
    assert (other.exit_code, "go on with the same options" in " ".join(other.stderr.replace("│", " ").split())) == (
        2,
        True,
    )


def test_a_pair_that_failed_is_compared_again_on_request(folders) -> None:
    (folders / "truth" / "same.npy").rename(folders / "same.npy")
    arguments = [folders / "pred", folders / "truth", "--jsonl", "-o", folders / "lines.jsonl", "--resume"]
    assert [run(*arguments).exit_code for _ in range(2)] == [1, 1]
    assert run(*arguments, "--retry-failed").exit_code == 1
    (folders / "same.npy").rename(folders / "truth" / "same.npy")
    assert run(*arguments).exit_code == 0  # a file that came since changes the pair
    for wrong in (["--resume"], ["--retry-failed"], ["--resume", "--jsonl", "-o", "x", "--html", "x.html"]):
        assert run(folders / "pred", folders / "truth", *wrong).exit_code == 2
