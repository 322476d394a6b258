"""Looking at a path before anybody reads it."""

from __future__ import annotations

import os
from pathlib import Path

from topokit.errors import ReadError


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
