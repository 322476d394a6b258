"""Real files with known topology: meshes exactly right, broken ones never wrongly certain."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import topokit as tk


def rows(data: Path, kind: str) -> list[dict]:
    return [row for row in json.loads((data / "index.json").read_text(encoding="utf-8")) if row["kind"] == kind]


def test_meshes_are_exactly_right_and_certain(real_data: Path) -> None:
    wrong = []
    for row in rows(real_data, "mesh"):
        report = tk.load(real_data / row["path"]).report()
        if (report.euler, report.genus, report.components) != (row["chi"], row["genus"], row["components"]):
            wrong.append((row["name"], report.euler, report.genus, report.components))
        if report.verdict != "certain":
            wrong.append((row["name"], report.verdict))
    assert wrong == []


def test_broken_meshes_are_never_wrongly_certain(real_data: Path) -> None:
    for row in rows(real_data, "bad"):
        if row.get("chi") is None:
            with pytest.raises(tk.TopokitError):
                tk.load(real_data / row["path"])
            continue
        report = tk.load(real_data / row["path"]).report()
        assert report.verdict != "certain" or report.euler == row["chi"], row["name"]
        if row["subkind"] == "open":
            assert not report.closed, row["name"]
            assert any("open" in reason for reason in report.reasons)


@pytest.mark.long
def test_scans_are_never_wrongly_likely(real_data: Path) -> None:
    """Those with a known truth, and the small ones; the large lidar scans are left to the accuracy score."""
    for row in rows(real_data, "points"):
        if row.get("chi") is None and (real_data / row["path"]).stat().st_size > 100_000:
            continue
        report = tk.load(real_data / row["path"]).report()
        assert report.verdict == "unsure" or report.euler == row.get("chi"), row["name"]
        assert report.estimate is not None
