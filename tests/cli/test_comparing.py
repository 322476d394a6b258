"""The command `topokit compare`: two files, two folders, labels, and the exit code."""

from __future__ import annotations

import csv
import io
import json

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
    assert found.stdout.startswith("filled.npy against filled.npy: parts 1 matched, 0 missing, 0 spurious; tunnels 0 ")
    assert "  - missing filled tunnel at voxel (4, 4, 2)" in found.stdout


def test_folders_as_csv_and_json_with_a_condition(folders) -> None:
    found = run(folders / "pred", folders / "truth", "--csv", "--fail-on", "missing1>0")
    rows = list(csv.DictReader(io.StringIO(found.stdout)))
    assert [(row["file"], row["missing1"], row["error"]) for row in rows] == [("filled", "1", ""), ("same", "0", "")]
    assert rows[1]["dice"] == "1.0"
    assert (found.exit_code, found.stderr) == (1, "topokit: filled meets missing1>0 (1)\n")
    records = [json.loads(line) for line in run(folders / "pred", folders / "truth", "--json").stdout.splitlines()]
    assert records[0]["features"][0]["kind"] == "filled tunnel"
    assert records[1]["missing"] == [0, 0, 0]


def test_labels_and_what_is_ignored(folders) -> None:
    found = run(folders / "pred", folders / "truth", "--csv", "--labels", "all", "--ignore", "0")
    rows = list(csv.DictReader(io.StringIO(found.stdout)))
    assert [(row["file"], row["label"], row["missing1"]) for row in rows] == [("filled", "1", "0"), ("same", "1", "0")]


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
