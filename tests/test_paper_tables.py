"""The script behind docs/paper-tables.md runs; with given normals, columns E and F of Table I are the paper's."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "paper_tables.py"
sys.path.insert(0, str(SCRIPT.parents[1]))

from benchmarks.paper.baselines import euler_of_mesh, longest_plateau, nearest_plateau, plateaus  # noqa: E402
from benchmarks.paper.curvature import K, estimated  # noqa: E402
from benchmarks.paper.curvature_errors import logs  # noqa: E402
from benchmarks.paper.printed import TABLE_1, TABLE_2  # noqa: E402
from benchmarks.paper.reconstructed import without_doubles  # noqa: E402
from benchmarks.paper.scores import errors, is_right, near  # noqa: E402
from benchmarks.paper.surfaces import COLUMNS  # noqa: E402
from benchmarks.paper_tables import main  # noqa: E402

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


def test_integers_are_right_when_equal_and_estimates_when_they_round() -> None:
    assert [is_right(value, 0) for value in (0, 1, 0.9, -0.9, 1.1, None, float("nan"))] == [1, 0, 1, 1, 0, 0, 0]
    assert errors([(None, 2), (float("inf"), 2), (1.5, 2)]) == [0.5]
    assert near([(None, 2), (1.6, 2), (3, 2)]) == 1


def test_a_torus_is_read_off_its_bars() -> None:
    """χ is 0 from α = 0.1 to 0.3, where the tunnel closes, then 1 until the void is filled at 0.5, then a ball's."""
    bars = [np.array([[0, np.inf], [0, 0.1]]), np.array([[0.1, np.inf], [0.1, 0.3]]), np.array([[0.1, 0.5]])]
    points = torch.tensor([[0.0, 0, 0], [4, 4, 4]]).repeat(200, 1)  # from a spacing of 0.2 to a quarter of 4
    found = plateaus(points, bars)
    assert [value for value, _ in found] == [0, 1, 0]
    assert [length for _, length in found] == pytest.approx([math.log(r) for r in (1.5, 5 / 3, 2)])
    assert longest_plateau(found) == 0
    assert nearest_plateau(found, 2) == 1
    assert longest_plateau([(1, 3.0)]) is None
    assert nearest_plateau([(2, 0.01)], 2) is None


@pytest.mark.long
def test_topology_quick_runs(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    words = [sys.executable, str(SCRIPT), "topology", "--quick", "--json", str(out)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=1800)  # against hanging
    content = json.loads(out.read_text(encoding="utf-8"))
    assert content["seconds"] < 120  # of the processor
    tables = content["tables"]
    assert [len(table["rows"]) for table in tables] == [20, 6, 12, 1, 6, 7]
    assert done.stdout.count("### ") == 6
    for table in (tables[0], tables[3]):  # samples alone, and with the vertices
        icosphere = next(row for row in table["rows"] if row[0] == "Icosphere")
        assert float(icosphere[5]) == pytest.approx(2, abs=0.1)


def test_doubles_are_merged_without_a_change_of_the_mesh() -> None:
    """A corner of a tetrahedron is there twice, with two triangles without area on the edge between its copies."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]])
    faces = np.array([[0, 2, 1], [4, 1, 3], [1, 2, 3], [4, 3, 2], [0, 1, 4], [0, 4, 2]])
    found = without_doubles((corners, faces))
    assert found[0].shape == (4, 3)
    assert found[1].shape == (4, 3)
    assert euler_of_mesh(found) == euler_of_mesh((corners, faces)) == 2
    area = [trimesh.Trimesh(*mesh, process=False).area for mesh in (found, (corners, faces))]
    assert area[0] == pytest.approx(area[1])


@pytest.mark.parametrize(
    ("words", "message"), [(["--data", "no/such"], "is not a folder"), (["--part", "density"], "has no part 'density'")]
)
def test_wrong_arguments_are_told(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["topology", *words]) == 2
    assert message in capsys.readouterr().err
