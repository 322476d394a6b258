"""Looking at a path before anybody reads it."""

from __future__ import annotations

import gzip
import os
import zipfile
from pathlib import Path
from typing import Any

from topokit.errors import ReadError, reading


def existing_file(source: str | os.PathLike[str]) -> Path:
    """The path, if it names a readable file with content.

    Raises:
        ReadError: if it is missing, a directory, empty or not readable.
    """
    path = Path(source)
    if path.is_dir():
        raise ReadError(f"{path} is a directory; give the files in it one by one.")
    if not path.exists():
        raise ReadError(f"{path} does not exist (looked in {Path.cwd()}).")
    if not path.is_file():
        raise ReadError(f"{path} is not a regular file.")
    if path.stat().st_size == 0:
        raise ReadError(f"{path} is empty (0 bytes); export it again.")
    if not os.access(path, os.R_OK):
        raise ReadError(f"{path} may not be read by this user; check its permissions.")
    return path


def file_of_folder(source: str | os.PathLike[str]) -> Path:
    """The path itself, or for the folder of an unzipped .sog the meta.json in it."""
    path = Path(source)
    return path / "meta.json" if (path / "meta.json").is_file() else path


def head(path: Path, size: int = 4096) -> bytes:
    """The first bytes of a file."""
    with path.open("rb") as file:
        return file.read(size)


def unpacked_head(path: Path, size: int = 4096) -> bytes:
    """The first bytes of a file, or of what a gzip file holds; of a broken gzip file its own."""
    beginning = head(path, size)
    if beginning.startswith(b"\x1f\x8b"):
        try:
            with gzip.open(path) as file:
                return file.read(size)
        except (OSError, EOFError):
            return beginning
    return beginning


def array_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Shapes of the arrays in a .npy or .npz file by lower-case name ("" for .npy), from their headers alone.

    Raises:
        ReadError: if it is malformed.
    """
    shapes = {}
    with reading(path, "the NumPy reader"):
        if not zipfile.is_zipfile(path):
            with path.open("rb") as file:
                return {"": _array_shape(file)}
        with zipfile.ZipFile(path) as archive:
            for name in archive.namelist():
                if name.endswith(".npy"):
                    with archive.open(name) as member:
                        shapes[name.removesuffix(".npy").lower()] = _array_shape(member)
    return shapes


def _array_shape(file: Any) -> tuple[int, ...]:
    from numpy.lib import format as npy

    read = npy.read_array_header_1_0 if npy.read_magic(file) == (1, 0) else npy.read_array_header_2_0
    return tuple(read(file)[0])
