"""Names of files in results: short, and different for different files."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from topokit.batch.names import distinguishing_names, names_in_common_folder
from topokit.batch.sources import Source


def sources(*names: str) -> list[Source]:
    return [Source(Path(name), name) for name in names]


@pytest.mark.parametrize(
    ("files", "shown"),
    [
        (["/a/x.ply", "/b/y.ply"], ["x.ply", "y.ply"]),
        (["/a/x.ply", "/b/x.ply", "c.ply"], ["a/x.ply", "b/x.ply", "c.ply"]),
        (["/r/1/m/x.ply", "/r/2/m/x.ply"], ["1/m/x.ply", "2/m/x.ply"]),
        (["x.ply", "a/x.ply", "b/x.ply"], ["x.ply", "a/x.ply", "b/x.ply"]),
        (["/a/x.ply", "/a/x.ply"], ["x.ply", "x.ply"]),
    ],
)
def test_as_few_folders_as_tell_files_apart(files: list[str], shown: list[str]) -> None:
    names = distinguishing_names(sources(*files))
    assert [names[str(file)] for file in files] == [str(Path(name)) for name in shown]


@pytest.mark.parametrize(
    ("files", "shown"),
    [
        (["/home/me/set/x.ply"], ["x.ply"]),
        (["/home/me/set/x.ply", "/home/me/set/more/x.ply"], ["x.ply", "more/x.ply"]),
        (["/home/me/a/x.ply", "/home/you/b/y.ply"], ["me/a/x.ply", "you/b/y.ply"]),
        (["set/x.ply", "set/../other/y.ply"], ["set/x.ply", "other/y.ply"]),
    ],
)
def test_pages_do_not_name_folders_that_all_files_share(files: list[str], shown: list[str]) -> None:
    names = names_in_common_folder(sources(*files))
    assert [names[file] for file in files] == shown


def test_standard_input_keeps_its_name() -> None:
    found = [*sources("/home/me/x.ply"), Source(Path("/tmp/topokit-1/stdin"), "-")]
    assert names_in_common_folder(found) == {"/home/me/x.ply": "x.ply", "-": "-"}
    assert names_in_common_folder(found[1:]) == {"-": "-"}


@pytest.mark.skipif(sys.platform != "win32", reason="drives are those of Windows")
def test_files_on_two_drives() -> None:
    names = names_in_common_folder(sources(r"C:\a\x.ply", r"D:\b\x.ply"))
    assert set(names.values()) == {r"a\x.ply", r"b\x.ply"}
