"""Surveys that were stopped and go on: no file twice, none lost, whatever the stop left behind."""

from __future__ import annotations

import json
import shutil
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import topokit as tk
from topokit.batch import examine as examination
from topokit.batch.journal import Journal
from topokit.batch.sources import Source
from topokit.errors import InputError

DATA = Path(__file__).resolve().parents[1] / "data"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "files").mkdir()
    for number in range(6):
        shutil.copy(DATA / ("truncated.stl" if number == 2 else "torus.stl"), tmp_path / "files" / f"{number}.stl")
    return tmp_path / "files"


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the files that were examined, in order."""
    names: list[str] = []
    original = examination._opened

    def watched(source: Source, questions: Any) -> Any:
        names.append(source.path.name)
        return original(source, questions)

    monkeypatch.setattr(examination, "_opened", watched)
    return names


def without_times(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{key: value for key, value in row.items() if key != "seconds"} for row in rows]


def test_a_stopped_survey_goes_on(folder: Path, tmp_path: Path, opened: list[str]) -> None:
    journal = tmp_path / "rows.jsonl"
    first = list(islice(tk.survey(folder, resume=journal), 4))
    assert len(first) == len(journal.read_text().splitlines()) == 4
    with journal.open("a") as file:
        file.write('{"file": "4.st')  # the machine stopped here
    survey = tk.survey(folder, resume=journal)
    assert without_times(survey.rows) == without_times(tk.survey(folder).rows)
    assert opened[:6] == [f"{number}.stl" for number in range(6)]
    assert [json.loads(line)["file"] for line in journal.read_text().splitlines()] == list(survey.files)
    del opened[:]
    assert tk.survey(folder, resume=journal).summary() == survey.summary()
    assert opened == []


def test_the_last_file_of_several_labels_is_done_again(tmp_path: Path, opened: list[str]) -> None:
    for name in ("a.npy", "b.npy"):
        np.save(tmp_path / name, np.arange(4).repeat(16).reshape(8, 2, 4))
    journal = tmp_path / "rows.jsonl"
    whole = tk.survey(tmp_path, labels="all", adapter="voxels", resume=journal).rows
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text("".join(lines[:5]))  # b has lost a label
    again = tk.survey(tmp_path, labels="all", adapter="voxels", resume=journal)
    assert without_times(again.rows) == without_times(whole)
    assert opened == ["a.npy", "b.npy", "b.npy"]


def test_new_files_are_added_and_others_stay(folder: Path, tmp_path: Path, opened: list[str]) -> None:
    journal = tmp_path / "rows.jsonl"
    assert len(tk.survey(folder / "0.stl", resume=journal).rows) == 1
    assert len(tk.survey(folder / "1.stl", resume=journal).rows) == 1
    assert len(tk.survey(folder, resume=journal).rows) == 6
    assert sorted(opened) == [f"{number}.stl" for number in range(6)]


@pytest.mark.parametrize(
    ("content", "message"),
    [("no json\n", "line 1, is not JSON"), ('{"name": "a"}\n', 'line 1, has no "file"'), ("[1]\n", 'has no "file"')],
)
def test_other_files_are_refused(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_text(content)
    with pytest.raises(InputError, match=message):
        Journal(path, {}).finished({})
    assert path.read_text() == content


def test_rows_of_something_else_are_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "rows.jsonl").write_text('{"file": "a.stl", "euler": 2}\n')
    with pytest.raises(InputError, match="other columns"):
        tk.survey(folder, resume=tmp_path / "rows.jsonl")


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (
            {},
            {"n_samples": 500},
            r'line 1, was examined with no options, and this run has the options {"n_samples": 500}',
        ),
        ({"details": True}, {}, r'with the options {"details": true}, and this run has no options'),
        ({"adapter": "mesh"}, {"adapter": "mesh", "n_samples": 9}, "go on with the same options, or write to another"),
    ],
)
def test_rows_of_other_options_are_refused(
    folder: Path, tmp_path: Path, before: dict[str, Any], after: dict[str, Any], message: str
) -> None:
    journal = tmp_path / "rows.jsonl"
    first = tk.survey(folder / "0.stl", resume=journal, **before).rows
    content = journal.read_text()
    with pytest.raises(InputError, match=message):
        tk.survey(folder, resume=journal, **after)
    assert journal.read_text() == content
    assert tk.survey(folder / "0.stl", resume=journal, **before).rows == first


def test_failed_files_are_tried_again_if_asked(folder: Path, tmp_path: Path, opened: list[str]) -> None:
    journal = tmp_path / "rows.jsonl"
    failed = [row["file"] for row in tk.survey(folder, resume=journal).rows if row["error"]]
    assert failed == [str(folder / "2.stl")]
    del opened[:]
    assert tk.survey(folder, resume=journal).rows[2]["error"]
    assert opened == []
    shutil.copy(DATA / "torus.stl", folder / "2.stl")
    assert not any(row["error"] for row in tk.survey(folder, resume=journal, retry_failed=True).rows)
    assert opened == ["2.stl"]
    assert len(journal.read_text().splitlines()) == 6


def test_a_label_that_failed_has_all_labels_of_its_file_examined_again(tmp_path: Path, opened: list[str]) -> None:
    for name in ("a.npy", "b.npy"):
        np.save(tmp_path / name, np.arange(4).repeat(16).reshape(8, 2, 4))
    path = tmp_path / "rows.jsonl"
    whole = tk.survey(tmp_path, labels="all", resume=path).rows
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    lines[1]["error"] = "it had no luck"
    path.write_text(
        "".join(json.dumps(line) + "\n" for line in [*lines, lines[-1] | {"file": "last", "source": {"path": "last"}}])
    )
    again = tk.survey(tmp_path, labels="all", resume=path, retry_failed=True)
    assert without_times(again.rows) == without_times(whole)
    assert opened == ["a.npy", "b.npy", "a.npy"]


def test_a_file_is_known_by_its_place_not_by_its_spelling(
    folder: Path, tmp_path: Path, opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = tmp_path / "rows.jsonl"
    (tmp_path / "link").symlink_to(folder)
    monkeypatch.chdir(tmp_path)
    first = tk.survey("files", resume=journal).rows
    del opened[:]
    for spelling in (folder, Path("link"), f"{tmp_path}/../{tmp_path.name}/files", "files/*.stl"):
        again = tk.survey(spelling, resume=journal)
        assert [row["genus"] for row in again.rows] == [row["genus"] for row in first]
        assert [row["file"] for row in again.rows] == list(again.files)
    assert opened == []
    assert len(journal.read_text().splitlines()) == 6


def test_a_file_that_was_replaced_is_examined_again(folder: Path, tmp_path: Path, opened: list[str]) -> None:
    journal = tmp_path / "rows.jsonl"
    assert [row["genus"] for row in tk.survey(folder, resume=journal).rows] == [1, 1, None, 1, 1, 1]
    del opened[:]
    shutil.copy(DATA / "sphere.ply", folder / "1.stl")
    (folder / "3.stl").unlink()
    (folder / "3.stl").write_bytes((DATA / "torus.stl").read_bytes())  # of the same size, but newer
    assert [row["genus"] for row in tk.survey(folder, resume=journal).rows] == [1, 0, None, 1, 1, 1]
    assert opened == ["1.stl", "3.stl"]
    assert len(journal.read_text().splitlines()) == 6


def test_lines_without_a_stamp_start_anew(folder: Path, tmp_path: Path, opened: list[str]) -> None:
    journal = tmp_path / "rows.jsonl"
    rows = tk.survey(folder, resume=journal).rows
    del opened[:]
    lines = [json.loads(line) for line in journal.read_text().splitlines()]
    journal.write_text(
        "".join(json.dumps({key: line[key] for key in line if key != "source"}) + "\n" for line in lines)
    )
    assert without_times(tk.survey(folder / "4.stl", resume=journal).rows) == without_times(rows[4:5])
    assert opened == ["4.stl"]
    assert without_times(tk.survey(folder, resume=journal).rows) == without_times(rows)
    assert sorted(opened) == ["0.stl", "1.stl", "2.stl", "3.stl", "4.stl", "5.stl"]


def test_one_file_under_two_names_has_one_row_for_each(folder: Path, tmp_path: Path, opened: list[str]) -> None:
    journal = tmp_path / "rows.jsonl"
    files = [folder / "0.stl", tmp_path / "other.stl"]
    files[1].symlink_to(files[0])
    for _ in range(2):
        assert [row["file"] for row in tk.survey(files, resume=journal).rows] == list(map(str, files))
    assert len(opened) == 2


def test_a_volume_of_many_files_is_examined_again_after_a_change(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    array = zarr.create_array(tmp_path / "ball.zarr", shape=(8, 8, 8), chunks=(4, 4, 4), dtype="uint8")
    array[2:6, 2:6, 2:6] = 1
    journal = tmp_path / "rows.jsonl"
    for value, cavities in ((1, 0), (0, 1)):
        array[3:5, 3:5, 3:5] = value
        (row,) = tk.survey(tmp_path / "ball.zarr", level=0.5, resume=journal).rows
        assert row["cavities"] == cavities
