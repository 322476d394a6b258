"""The first bytes of files, packed or damaged, and what .ply and NumPy headers announce."""

from __future__ import annotations

import gzip
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from intact_files import FLAT

import topokit as tk
from topokit.errors import ReadError
from topokit.inputs.files import existing_file, head
from topokit.inputs.headers import array_shapes, numpy_kind, ply_kind

HEADER = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"


def test_the_head_of_a_gzip_file_is_that_of_its_content(tmp_path: Path) -> None:
    path = tmp_path / "packed.gz"
    path.write_bytes(gzip.compress(b"inside" * 100))
    assert head(path, 6) == b"inside"
    assert head(tmp_path) == b""


@pytest.mark.parametrize("damage", ["truncated", "garbage", "no gzip"])
def test_the_head_of_a_broken_gzip_file_is_its_own(tmp_path: Path, damage: str) -> None:
    packed = gzip.compress(bytes(range(256)) * 400)
    content = {"truncated": packed[:12], "garbage": packed[:10] + b"\xff" * 50, "no gzip": b"\x1f\x8b" + b"\0" * 20}
    path = tmp_path / "broken.gz"
    path.write_bytes(content[damage])
    assert head(path) == content[damage]


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    for name, reason in (("", "is a directory"), ("nowhere", "does not exist"), ("empty", "is empty")):
        with pytest.raises(ReadError, match=reason):
            existing_file(tmp_path / name)


@pytest.mark.parametrize(
    ("beginning", "kind"),
    [
        (b"solid", None),
        (HEADER + b"end_header\n", "points"),
        (HEADER + b"element face 0\nend_header\n", "points"),
        (HEADER + b"element face 2\nend_header\n", "mesh"),
        (HEADER + b"end_header\nelement face 2\n", "points"),
        (HEADER + b"property uint packed_position\nend_header\n", "splats"),
        (HEADER + b"property float scale_0\nproperty float scale_1\nproperty float rot_3\nend_header\n", "splats"),
    ],
)
def test_what_a_ply_header_announces(beginning: bytes, kind: str | None) -> None:
    assert ply_kind(beginning) == kind


def test_what_numpy_headers_announce(tmp_path: Path) -> None:
    cloud, volume, named = tmp_path / "a.npy", tmp_path / "b.npy", tmp_path / "c.npz"
    np.save(cloud, np.zeros((5, 3)))
    np.save(volume, np.zeros((4, 5, 6)))
    np.savez(named, Points=np.zeros((5, 3)), grid=np.zeros((2, 2, 2)))
    assert [numpy_kind(path, head(path)) for path in (cloud, volume, named)] == ["points", "volume", "points"]
    assert array_shapes(named) == {"points": (5, 3), "grid": (2, 2, 2)}
    volume.write_bytes(volume.read_bytes()[:20])
    assert numpy_kind(volume, head(volume)) == "points"
    named.write_bytes(b"words")
    assert numpy_kind(named, head(named)) is None


@pytest.mark.skipif(sys.platform != "linux", reason="other systems refuse such names")
@pytest.mark.parametrize("kind", ["stl", "stl as text", "ply as text", "npy points", "parquet", "3dgs", "splat", "pcd"])
def test_names_need_not_be_utf_8(tmp_path: Path, kind: str) -> None:
    name, write = FLAT[kind]
    path = tmp_path / f"{os.fsdecode(bytes([0xE9, 0x1B]))}{Path(name).suffix}"
    path.write_bytes(write(np.random.default_rng(3)))
    assert tk.load(path, n_neighbors=3).samples.n_points > 0
    path.write_bytes(path.read_bytes()[:20])
    with pytest.raises(tk.TopokitError):
        tk.load(path).report()
