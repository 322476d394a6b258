"""Files by path, folder and pattern."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from topokit.batch.sources import find_sources

DATA = Path(__file__).resolve().parents[1] / "data"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Meshes at two depths, a cloud called .txt, and what is none."""
    (tmp_path / "deep" / "deeper").mkdir(parents=True)
    (tmp_path / ".hidden").mkdir()
    for target in ("b.ply", "deep/a.ply", "deep/deeper/c.ply", ".hidden/d.ply", ".e.ply"):
        shutil.copy(DATA / "sphere.ply", tmp_path / target)
    shutil.copy(DATA / "sphere.ply", tmp_path / "no_suffix")
    (tmp_path / "cloud.txt").write_text("x y z\n" + "0 0 1\n" * 30)
    (tmp_path / "notes.txt").write_text("the quick brown fox\n")
    (tmp_path / "table.csv").write_text("name,genus\na,1\n")
    (tmp_path / "numbers.json").write_text("[1, 2, 3]")
    (tmp_path / "empty.stl").touch()
    return tmp_path


def names(folder: Path, *paths: Path | str, adapter: str | None = None) -> list[str]:
    return [os.path.relpath(source.path, folder) for source in find_sources(paths or folder, adapter).sources]


def test_a_folder_stands_for_the_files_in_it_that_an_adapter_knows(folder: Path) -> None:
    found = names(folder)
    assert found == ["b.ply", "cloud.txt", "deep/a.ply", "deep/deeper/c.ply", "empty.stl", "no_suffix"]
    passed_over = find_sources(folder).passed_over
    assert [Path(name).name for name in passed_over] == ["notes.txt", "numbers.json", "table.csv"]


def test_an_adapter_takes_its_own_files_of_a_folder(folder: Path) -> None:
    assert names(folder, adapter="points") == ["b.ply", "cloud.txt", "deep/a.ply", "deep/deeper/c.ply"]
    assert "cloud.txt" not in names(folder, adapter="mesh")
    assert "b.ply" in names(folder, adapter="open3d")  # it recognizes nothing by itself
    assert names(folder, adapter="occupancy") == ["."]  # none is a network


def test_files_are_taken_as_they_are_named(folder: Path) -> None:
    given = (folder / "notes.txt", folder / "gone.ply", folder / "b.ply", folder / "b.ply")
    assert names(folder, *given) == ["notes.txt", "gone.ply", "b.ply", "b.ply"]


def test_patterns(folder: Path) -> None:
    assert names(folder, f"{folder}/*.ply") == ["b.ply"]
    assert names(folder, f"{folder}/**/*.ply") == ["b.ply", "deep/a.ply", "deep/deeper/c.ply"]
    shutil.copy(DATA / "sphere.ply", folder / "deep" / "B.PLY")
    assert names(folder, f"{folder}/**/*.ply") == ["b.ply", "deep/B.PLY", "deep/a.ply", "deep/deeper/c.ply"]
    assert names(folder, f"{folder}/**/*.PLY") == ["b.ply", "deep/B.PLY", "deep/a.ply", "deep/deeper/c.ply"]
    (folder / "deep" / "B.PLY").unlink()
    assert names(folder, f"{folder}/d*") == ["deep/a.ply", "deep/deeper/c.ply"]
    assert names(folder, f"{folder}/*.obj") == ["*.obj"]  # opening it says that it does not exist
    bracketed = folder / "part[1].ply"
    shutil.copy(DATA / "sphere.ply", bracketed)
    assert names(folder, bracketed) == ["part[1].ply"]


def test_a_folder_without_shapes_is_a_problem_not_a_success(folder: Path) -> None:
    (folder / "none").mkdir()
    (source,) = find_sources(folder / "none").sources
    assert source.problem is not None
    assert "holds nothing that topokit opens: it is empty" in source.problem
    (folder / "none" / "a.json").touch()
    (source,) = find_sources(folder / "none").sources
    assert "of its 1 file none is of a known format" in str(source.problem)


def test_a_folder_that_is_one_scene_is_not_searched(tmp_path: Path) -> None:
    scene = tmp_path / "captures" / "one"
    scene.mkdir(parents=True)
    (scene / "meta.json").write_text('{"means": {}, "quats": {}}')
    (scene / "means_l.webp").write_bytes(b"RIFF")
    assert names(tmp_path, tmp_path / "captures") == ["captures/one"]


def test_links_in_a_circle_and_pipes_are_left_alone(folder: Path) -> None:
    before = names(folder)
    (folder / "deep" / "up").symlink_to(folder)
    os.mkfifo(folder / "pipe.ply")
    assert names(folder) == before
