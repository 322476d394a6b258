"""A survey: rows as they come, the same in one process and in several, and numbers about the set."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

import topokit as tk
from topokit.batch.examine import COLUMNS
from topokit.batch.widths import COUNTS, NARROWEST
from topokit.testing import genus_mesh, icosphere, sphere_samples, torus_mesh

DATA = Path(__file__).resolve().parents[1] / "data"

CRASHING = '''
"""A reader that ends its process."""
import os
from topokit import Adapter

class Crash(Adapter):
    name, description, suffixes = "crash", "files that end the process", (".crash",)

    def open(self, source, *, n_samples=10):
        os.abort() if "abort" in source.name else 1 / 0
'''


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("sphere.ply", "torus.stl", "bowl.obj", "edge_sharing_cubes.obj", "truncated.stl"):
        shutil.copy(DATA / name, tmp_path)
    np.savetxt(tmp_path / "points.xyz", sphere_samples(600).points.numpy())
    return tmp_path


def without_times(rows: list[dict[str, object]]) -> list[dict[str, object]]:
    return [{key: value for key, value in row.items() if key != "seconds"} for row in rows]


def test_rows_are_plain_and_complete(folder: Path) -> None:
    survey = tk.survey(folder)
    assert [Path(name).name for name in survey.files] == sorted(path.name for path in folder.iterdir())
    rows = {Path(row["file"]).name: row for row in survey.rows}
    assert all(tuple(row) == COLUMNS for row in rows.values())
    assert all(type(value) in (str, int, float, bool, type(None)) for row in rows.values() for value in row.values())
    shown = ("verdict", "euler", "genus", "components", "tunnels", "boundary_loops", "closed", "manifold", "adapter")
    assert [rows["torus.stl"][key] for key in shown] == ["certain", 0, 1, 1, 1, 0, True, True, "mesh"]
    assert [rows["bowl.obj"][key] for key in shown] == ["certain", 1, 0, 1, None, 1, False, True, "mesh"]
    assert [rows["edge_sharing_cubes.obj"][key] for key in shown[-4:]] == [0, False, False, "mesh"]
    assert rows["points.xyz"]["adapter"] == "points"
    assert "truncated.stl" in rows["truncated.stl"]["error"]
    assert rows["truncated.stl"]["euler"] is None


def test_rows_come_one_by_one_and_nothing_is_examined_twice(folder: Path) -> None:
    survey = tk.survey([folder / "sphere.ply", folder / "gone.ply", folder / "torus.stl"])
    assert next(iter(survey))["euler"] == 2
    assert repr(survey) == "Survey(3 files, 1 examined)"
    (folder / "sphere.ply").unlink()
    assert [row["euler"] for row in survey.rows] == [2, None, 0]
    shutil.rmtree(folder)
    one, other = iter(survey), iter(survey)
    assert [(next(one)["file"], next(other)["file"]) for _ in range(3)] == [(name, name) for name in survey.files]


def test_two_readers_of_a_survey_share_its_rows(folder: Path) -> None:
    survey = tk.survey(folder)
    one, other = iter(survey), iter(survey)
    pairs = [(next(one)["file"], next(other)["file"]) for _ in survey.files]
    assert pairs == [(name, name) for name in survey.files]
    assert len(survey.rows) == len(survey.files)


def test_processes_change_nothing_and_a_file_that_ends_one_costs_one_row(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    package = tmp_path_factory.mktemp("package")
    (package / "topokit_crash.py").write_text(CRASHING)
    info = package / "crash-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: crash\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[topokit.adapters]\ncrash = topokit_crash:Crash\n")
    shape = tk.from_mesh(genus_mesh(2)).replace(name="made")
    expected = without_times(tk.survey([shape, folder]).rows)
    monkeypatch.syspath_prepend(str(package))
    tk.refresh_adapters()
    (folder / "abort.crash").write_text("x")
    (folder / "divide.crash").write_text("x")
    rows = {Path(row["file"]).name: row for row in tk.survey([shape, folder], jobs=2).rows}
    monkeypatch.undo()
    tk.refresh_adapters()
    assert rows["abort.crash"]["error"].endswith("its process died (SIGABRT, Aborted).")
    assert "ZeroDivisionError" in rows["divide.crash"]["error"]
    assert without_times([row for name, row in rows.items() if not name.endswith(".crash")]) == expected


def test_a_bug_in_lazy_code_is_a_row_too(tmp_path: Path) -> None:
    def open_it(path: Path) -> tk.Shape:
        """Samples that cannot be made."""
        return tk.Shape(lambda: 1 // 0)  # type: ignore[arg-type, return-value]

    tk.register_adapter("lazy", open_it, suffixes=(".lazy",), overwrite=True)
    (tmp_path / "a.lazy").write_text("x")
    (row,) = tk.survey(tmp_path).rows
    assert row["error"].endswith(
        "a.lazy could not be examined (ZeroDivisionError: integer division or modulo by zero)."
    )


def test_labels_have_rows_of_their_own(tmp_path: Path) -> None:
    volume = np.zeros((9, 9, 9), dtype=np.uint8)
    volume[1:6, 1:6, 1:6], volume[3, 3, 1:6], volume[7, 7, 7] = 4, 9, 9
    np.save(tmp_path / "parts.npy", volume)
    shutil.copy(DATA / "sphere.ply", tmp_path)
    rows = tk.survey(tmp_path, labels="all", connectivity=6).rows
    assert [(row["label"], row["genus"], row["components"]) for row in rows[:2]] == [(4, 1, 1), (9, 0, 2)]
    assert "'mesh' opens no labels" in rows[2]["error"]
    (row,) = tk.survey(tmp_path / "parts.npy", labels=[9], level=3.0).rows
    assert row["error"].endswith("with labels there is no level=…; leave it out.")


def test_every_file_has_the_same_seed(folder: Path) -> None:
    files = [folder / "torus.stl"] * 2
    for generator in (5, torch.Generator().manual_seed(5)):
        first, second = tk.survey(files, details=True, generator=generator, n_samples=300).rows
        assert first["estimate"] == second["estimate"]
    assert tk.survey(files[:1], details=True, n_samples=300).rows[0]["estimate"] != first["estimate"]


def test_details_are_columns(folder: Path) -> None:
    (row,) = tk.survey(folder / "sphere.ply", details=True).rows
    assert abs(row["estimate"] - 2) < 0.5
    assert row["refined"] is not None


def test_widths_are_columns_of_rows_tables_and_files(tmp_path: Path) -> None:
    pytest.importorskip("cripser")
    parquet = pytest.importorskip("pyarrow.parquet")
    torus = tk.from_mesh(*torus_mesh(24, 12, major=1.0, minor=0.3))
    found = tk.survey([torus.replace(name="torus")], features=0.5)
    (row,) = found
    assert (row["above_genus"], row["above_tunnels"], row["narrowest_cavity"]) == (1, 1, math.inf)
    assert row["narrowest_tunnel"] == pytest.approx(0.6, abs=0.05)
    assert list(found.to_pandas().columns)[-8:] == [*COUNTS, *NARROWEST]
    found.save_parquet(tmp_path / "rows.parquet")
    schema = parquet.read_schema(tmp_path / "rows.parquet")
    assert [str(schema.field(name).type) for name in ("above_genus", "narrowest_part")] == ["int64", "double"]
    failed = tk.survey(["missing.stl", "also.stl"], features=True)
    assert all(set(NARROWEST) <= row.keys() for row in failed)


def test_a_page_of_all_files_and_a_light_one(folder: Path) -> None:
    survey = tk.survey(folder)
    pages = []
    for light in (False, True):
        survey.save_html(folder.parent / "page.html", title="All of them", light=light)
        pages.append((folder.parent / "page.html").read_text(encoding="utf-8"))
        assert ("<img" in pages[-1], 'id="scene-' in pages[-1]) == (not light, not light)
        assert pages[-1].count('class="name"') == 6
    page = pages[0]
    assert page.count("data:image/webp") == 5
    assert "All of them" in page
    assert "truncated.stl" in page
    with pytest.raises(tk.InputError, match="must be called"):
        survey.save_html(folder / "page.txt")


def meshes(folder: Path, genera: list[int]) -> Path:
    folder.mkdir()
    for number, genus in enumerate(genera):
        mesh = icosphere(1) if genus == 0 else torus_mesh(8, 5) if genus == 1 else genus_mesh(genus, resolution=8)
        tk.from_mesh(mesh).to_trimesh().export(folder / f"{number}.off")
    return folder


def test_a_set_in_numbers(folder: Path) -> None:
    summary = tk.survey(folder).summary()
    assert (summary.n_shapes, summary.n_errors) == (5, 1)
    assert summary.closed == summary.closed_manifold == 3 / 5
    assert summary.manifold == 4 / 5
    assert sum(summary.verdicts.values()) == 1
    assert summary.genus[1] == 1
    assert sum(summary.genus.values()) == sum(summary.components.values()) == 5


def test_the_distance_between_two_sets(tmp_path: Path) -> None:
    learned, made = (meshes(tmp_path / name, genera) for name, genera in (("a", [0, 0, 1, 1]), ("b", [0, 1, 1, 2])))
    first, second = tk.survey(learned), tk.survey(made)
    assert first.distance(first).total_variation == 0
    assert first.distance(second).total_variation == second.distance(first).total_variation == 0.25
    assert first.distance(second).genus_wasserstein == 0.5  # two of four shapes change by one handle each
    with pytest.raises(tk.InputError, match="has no shape that could be examined"):
        first.distance(tk.survey([tmp_path / "gone"]))


def test_shapes_in_memory_have_rows_like_files(tmp_path: Path) -> None:
    shapes = [tk.from_mesh(genus_mesh(genus)).replace(name=f"made {genus}") for genus in (1, 2)]
    survey = tk.survey([*shapes, meshes(tmp_path / "files", [2])])
    assert (len(survey), [row["genus"] for row in survey.rows]) == (3, [1, 2, 2])
    assert survey[0] == survey.rows[0]
    assert survey[0]["file"] == "made 1"
    assert survey[1] | {"file": "", "adapter": "", "seconds": 0} == survey[2] | {
        "file": "",
        "adapter": "",
        "seconds": 0,
    }
    assert tk.survey(shapes).summary().genus == {1: 1, 2: 1}
    for wrong in ({"n_samples": 500}, {"labels": "all"}, {"resume": tmp_path / "rows.jsonl"}):
        with pytest.raises(tk.InputError, match=next(iter(wrong))):
            tk.survey(shapes, **wrong)
    tk.survey(shapes).save_html(tmp_path / "made.html")
    assert "made 2" in (tmp_path / "made.html").read_text(encoding="utf-8")


def test_a_survey_is_shown_in_notebooks_and_becomes_a_data_frame(folder: Path) -> None:
    survey = tk.survey(folder)
    assert "<td>" not in survey._repr_html_()  # nothing is examined for it
    table = pytest.importorskip("pandas") and survey.to_pandas()
    assert list(table.columns) == list(COLUMNS)
    assert len(table) == len(survey) == 6
    assert survey._repr_html_().count("<tr>") == 7


def test_what_is_no_path_is_refused_with_the_way_out(tmp_path: Path) -> None:
    for paths in ([tmp_path, 3], [3.0], [icosphere(1)]):
        with pytest.raises(tk.InputError, match=r"topokit\.load"):
            tk.survey(paths)  # type: ignore[arg-type]
    for path in (tmp_path / "nodir", str(tmp_path / "*.stl")):
        with pytest.raises(tk.InputError, match="does not exist"):
            tk.survey(path)
    with pytest.raises(tk.ReadError, match=r"topokit\.survey"):
        tk.load(tmp_path)


def test_jobs_are_checked(folder: Path) -> None:
    with pytest.raises(tk.InputError, match="jobs must be 0 or more, not -1"):
        tk.survey(folder, jobs=-1)
    assert tk.survey([]).rows == []
    assert tk.survey([], jobs=2).rows == []
