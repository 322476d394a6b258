"""Conditions of --fail-on about faults of meshes and about widths, and that JSON and CSV hold the same numbers."""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from topokit.batch.widths import COUNTS, NARROWEST
from topokit.cli.app import app
from topokit.testing import icosphere, torus_mesh
from topokit.testing.meshes import joined

FAULTS = ("flipped", "inverted", "self_intersections")


def report(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["report", *map(str, arguments)])


@pytest.fixture
def faulty(tmp_path: Path) -> Path:
    """Three spheres: one with two faces flipped, one inside out, and one that crosses the first."""
    vertices, faces = icosphere(1)
    flipped = faces.copy()
    flipped[:2] = flipped[:2, ::-1]
    crossing = vertices + np.array([1.1, 0.03, 0.02])
    inverted = 0.5 * vertices + np.array([0.0, 5.0, 0.0])
    points, triangles = joined((vertices, flipped), (inverted, faces[:, ::-1]), (crossing, faces))
    path = tmp_path / "faulty.obj"
    rows = [f"v {x} {y} {z}" for x, y, z in points] + [f"f {a} {b} {c}" for a, b, c in triangles + 1]
    path.write_text("\n".join(rows))
    return path


def test_faults_are_numbers_and_conditions(faulty: Path) -> None:
    pytest.importorskip("igl")
    found = report(faulty, "--csv", "--fail-on", "inverted>0,flipped>1,flipped>2,self-intersections>0")
    assert found.exit_code == 1
    assert found.stderr.splitlines() == [
        f"topokit: {faulty} meets inverted>0 (1), flipped>1 (2), self-intersections>0 (1)"
    ]
    (row,) = csv.DictReader(io.StringIO(found.stdout))
    assert [row[name] for name in FAULTS] == ["2", "1", "1"]
    (kept,) = json.loads(report(faulty, "--json", "--locate").stdout)
    assert [kept[name] for name in FAULTS] == [2, 1, 1]
    (inside_out,) = (one for one in kept["location"]["defects"] if one["kind"] == "inverted component")
    np.testing.assert_allclose(inside_out["center"], (0, 5, 0), atol=0.05)


def test_the_text_says_where_a_component_is_inside_out(faulty: Path) -> None:
    text = report(faulty, "-v").stdout
    assert "1 closed component facing inward without bounding a cavity (inverted), around (0.000, 5.000, 0.000)" in text
    assert "2 faces turned against the others (flipped)" in text


def test_self_intersections_are_unknown_without_the_library(faulty: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "igl", None)
    monkeypatch.setitem(sys.modules, "igl.predicates", None)
    found = report(faulty, "--text", "--fail-on", "self_intersections>0")
    assert (found.exit_code, found.stderr) == (1, f"topokit: {faulty} meets self_intersections>0 (unknown)\n")
    assert "Self-intersections were not located" in found.stdout
    assert 'pip install "topokit[defects]"' in found.stdout


@pytest.fixture
def narrow(tmp_path: Path) -> Path:
    """A torus whose handle is 0.4 thick and whose tunnel is 1.6 wide, and a broken file."""
    vertices, faces = torus_mesh(48, 24, major=1.0, minor=0.2)
    rows = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    (tmp_path / "torus.obj").write_text("\n".join(rows))
    (tmp_path / "empty.ply").write_text("")
    return tmp_path


def test_counts_above_a_width_are_columns_and_conditions(narrow: Path) -> None:
    pytest.importorskip("cripser")
    torus, conditions = narrow / "torus.obj", "above_genus>0,genus>0,narrowest_tunnel<0.45,narrowest_cavity<9"
    found = report(narrow, "--above", 0.3, "--csv", "--fail-on", conditions)
    empty, row = csv.DictReader(io.StringIO(found.stdout))
    assert [row[name] for name in COUNTS] == ["1", "1", "0", "0", "1"]
    assert float(row["narrowest_tunnel"]) == pytest.approx(0.4, abs=0.05)
    assert row["narrowest_cavity"] == "inf"
    assert {empty[name] for name in (*COUNTS, *NARROWEST)} == {""}
    met = f"above_genus>0 (1), genus>0 (1), narrowest_tunnel<0.45 ({float(row['narrowest_tunnel']):.4g})"
    assert found.stderr.splitlines()[-1] == f"topokit: {torus} meets {met}"
    wide = report(torus, "--above", 0.6, "--json", "--fail-on", "above_genus>0")
    (kept,) = json.loads(wide.stdout)
    assert (wide.exit_code, kept["above_genus"], kept["genus"], kept["narrowest_tunnel"]) == (0, 0, 1, None)


def test_a_table_has_the_counts_above_a_width(narrow: Path) -> None:
    pytest.importorskip("cripser")
    title, _, row = report(narrow, "--above", 0.3, "--table").stdout.splitlines()
    for name, value in (("above genus", "1"), ("above cavities", "0"), ("narrowest cavity", "inf")):
        end = title.index(name) + len(name)
        assert row[:end].split()[-1] == value


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--fail-on", "above_genus>0"), "report --above WIDTH measures"),
        (("--features", "--fail-on", "above_genus>0"), "report --above WIDTH measures"),
        (("--fail-on", "narrowest_tunnel<1.5"), "report --features or --above WIDTH measures"),
        (("--above", "1", "--fail-on", "above_genus>0.5"), "is no condition"),
    ],
)
def test_conditions_about_widths_need_widths(narrow: Path, options: tuple[str, ...], message: str) -> None:
    found = report(narrow / "torus.obj", *options)
    assert found.exit_code == 2
    assert message in " ".join(found.stderr.replace("│", " ").split())
