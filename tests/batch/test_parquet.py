"""Rows of a survey in Parquet: equal to the rows, with types that do not depend on what is in them."""

from __future__ import annotations

from pathlib import Path

import pytest

import topokit as tk
from topokit.batch import parquet
from topokit.batch.examine import COLUMNS
from topokit.testing import genus_mesh

pq = pytest.importorskip("pyarrow.parquet", reason="Parquet needs pyarrow")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "meshes"
    folder.mkdir()
    for number, genus in enumerate((1, 2, 2)):
        tk.from_mesh(genus_mesh(genus)).to_trimesh().export(folder / f"{number}.off")
    (folder / "3.off").write_text("OFF nonsense")
    return folder


def test_the_table_holds_the_rows(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parquet, "_GROUP", 3)
    survey = tk.survey(folder)
    survey.save_parquet(tmp_path / "rows.parquet")
    table = pq.read_table(tmp_path / "rows.parquet")
    assert table.to_pylist() == survey.rows
    assert table.column_names == list(COLUMNS)
    assert pq.ParquetFile(tmp_path / "rows.parquet").num_row_groups == 2


def test_types_are_the_same_where_all_is_unknown(folder: Path, tmp_path: Path) -> None:
    tk.survey(folder).save_parquet(tmp_path / "all.parquet")
    tk.survey([folder / "3.off"]).save_parquet(tmp_path / "error.parquet")
    tk.survey([]).save_parquet(tmp_path / "none.parquet")
    schemas = [pq.read_schema(tmp_path / f"{name}.parquet") for name in ("all", "error", "none")]
    assert schemas[0] == schemas[1] == schemas[2]


def test_a_survey_that_is_stopped_leaves_no_half_file(folder: Path, tmp_path: Path) -> None:
    survey = tk.survey(folder)
    survey._rows[0] = [dict.fromkeys(COLUMNS) | {"genus": "many"}]  # type: ignore[assignment]
    with pytest.raises((TypeError, ValueError)):
        survey.save_parquet(tmp_path / "rows.parquet")
    assert list(tmp_path.glob("*.parquet")) == list(tmp_path.glob(".*")) == []


def test_without_pyarrow_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(tk.MissingDependencyError, match=r"topokit\[cluster\]"):
        tk.survey([]).save_parquet(tmp_path / "rows.parquet")
