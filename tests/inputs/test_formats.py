"""Tables of formats: every row names readers that exist, and rows say what a file is."""

from __future__ import annotations

import gzip
import pkgutil
from pathlib import Path

import numpy as np
import pytest

from topokit.adapters.mesh.entry import FORMATS as OF_MESHES
from topokit.adapters.points.entry import FORMATS as OF_POINTS
from topokit.adapters.splats.entry import FORMATS as OF_SPLATS
from topokit.adapters.voxels.chosen_part import Entry
from topokit.adapters.voxels.entry import FORMATS as OF_VOLUMES
from topokit.inputs.formats import Format, Formats, format_of, is_certainly, stored_in


@pytest.mark.parametrize("row", [*OF_MESHES, *OF_POINTS, *OF_VOLUMES, *OF_SPLATS], ids=lambda row: row.name)
def test_every_row_has_a_reader(row: Format) -> None:
    named = [name for name in (row.read, row.stored) if name is not None]
    assert named
    assert all(callable(pkgutil.resolve_name(name)) for name in named)


@pytest.mark.parametrize("formats", [OF_MESHES, OF_POINTS, OF_VOLUMES, OF_SPLATS])
def test_each_suffix_belongs_to_one_row(formats: Formats) -> None:
    suffixes = [suffix for row in formats for suffix in row.suffixes]
    assert len(set(suffixes)) == len(suffixes)


def test_arrays_are_points_or_volumes(tmp_path: Path) -> None:
    np.save(tmp_path / "points.npy", np.zeros((9, 3)))
    np.save(tmp_path / "volume.npy", np.zeros((3, 3, 3)))
    for name, wanted in (("points.npy", [True, False]), ("volume.npy", [False, True])):
        path = tmp_path / name
        assert [is_certainly(formats, path) for formats in (OF_POINTS, OF_VOLUMES)] == wanted
        assert {found.name for formats in (OF_POINTS, OF_VOLUMES) if (found := format_of(formats, path))}
        assert [stored_in(OF_POINTS, path) is not None, stored_in(OF_VOLUMES, path, Entry()) is not None] == wanted


@pytest.mark.parametrize("name", ["a.xyz", "a.npy"])
def test_what_gzip_packed_is_read_as_a_whole(name: str, tmp_path: Path) -> None:
    plain = tmp_path / name
    if name.endswith(".npy"):
        np.save(plain, np.eye(3))
    else:
        np.savetxt(plain, np.eye(3))
    packed = tmp_path / f"{name}.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    assert stored_in(OF_POINTS, plain).n_points == 3
    assert stored_in(OF_POINTS, packed) is None
    assert format_of(OF_POINTS, packed) == format_of(OF_POINTS, plain)


def test_text_is_never_certain_and_folders_are_no_points(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("0 0 1\n" * 9)
    assert not is_certainly(OF_POINTS, tmp_path / "a.xyz")
    assert not is_certainly(OF_POINTS, tmp_path)
    assert stored_in(OF_VOLUMES, tmp_path, Entry()) is None
