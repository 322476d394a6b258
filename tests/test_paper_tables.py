"""The script behind docs/paper-tables.md runs; with given normals, columns E and F of Table I are the paper's."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "paper_tables.py"
sys.path.insert(0, str(SCRIPT.parents[1]))

from benchmarks.paper.curvature import K, estimated, logs  # noqa: E402
from benchmarks.paper.printed import TABLE_1, TABLE_2  # noqa: E402
from benchmarks.paper.surfaces import COLUMNS  # noqa: E402
from benchmarks.paper.topology import is_right  # noqa: E402

PRINTED_RIGHT = {"Taubin": (0, 1, 0), "Normal": (1, 1, 1), "Quadric": (3, 3, 3), "Ours": (13, 17, 11)}


@pytest.mark.parametrize("column", ["E", "F"])
def test_given_normals_reproduce_the_paper(column: str) -> None:
    """The error is a property of point spacing: the same 70 000 points, one draw."""
    known, points = COLUMNS[column].samples(seed=0)
    found = estimated(known, points, K, "given")
    (_, printed), _, _ = TABLE_1["Our"][column]
    assert logs((found.gaussian - known.gaussian).abs())[1] == pytest.approx(printed, abs=0.1)
    assert abs(found.euler) < 0.5


def test_the_paper_scored_again() -> None:
    for column, (name, wanted) in enumerate(PRINTED_RIGHT.items()):
        right = tuple(sum(is_right(row[s][column], euler) for euler, row in TABLE_2.values()) for s in range(3))
        assert right == wanted, name


@pytest.mark.long
def test_topology_quick_runs(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    words = [sys.executable, str(SCRIPT), "topology", "--quick", "--json", str(out)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=240)
    tables = json.loads(out.read_text(encoding="utf-8"))["tables"]
    assert [len(table["rows"]) for table in tables] == [20, 12, 7]
    assert done.stdout.count("### ") == 3
    icosphere = next(row for row in tables[0]["rows"] if row[0] == "Icosphere")
    assert float(icosphere[5]) == pytest.approx(2, abs=0.1)
    missing = subprocess.run([*words[:3], "--data", str(tmp_path / "no")], capture_output=True, text=True)
    assert missing.returncode == 2
    assert "is not a folder" in missing.stderr
