"""Limits on what files announce and expand to: they depend on the size of the file."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from topokit.errors import ReadError
from topokit.inputs.size_limits import require_bytes, require_expansion, require_members


def test_headers_are_held_against_the_size_of_the_file() -> None:
    require_bytes(Path("a.las"), "9 points", 100, 100)
    with pytest.raises(
        ReadError, match=r"a\.las announces 9 points, which takes at least 101 bytes, but has 100 bytes"
    ):
        require_bytes(Path("a.las"), "9 points", 101, 100)
    require_expansion("a.spz", 1 << 28, 10)
    require_expansion("a.spz", 200 * (1 << 21), 1 << 21)
    with pytest.raises(ReadError, match=r"a\.spz has 10 bytes .*decompression bomb"):
        require_expansion("a.spz", (1 << 28) + 1, 10)


def test_members_of_archives_are_held_against_the_size_of_the_file(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("one", bytes(3_000_000))
        archive.writestr("two", bytes(3_000_000))
        members = archive.infolist()
    require_members(tmp_path / "a.zip", members)
    with pytest.raises(ReadError, match="content of 6000000 bytes, more than 200 times"):
        require_members(tmp_path / "a.zip", members, free=100)
    members[1].compress_size = 1 << 30
    with pytest.raises(ReadError, match=r"2 members of 10737\d+ packed bytes"):
        require_members(tmp_path / "a.zip", members)
