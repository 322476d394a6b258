"""Paths, the first bytes of files, and files that belong to the given one: only those in its own folder are opened."""

from __future__ import annotations

import gzip
import os
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from topokit.errors import ReadError

HEAD = 1 << 16  # bytes that tell one format from another
ZIP, GZIP = b"PK\x03\x04", b"\x1f\x8b"
BEGINNINGS = {".ply": b"ply", ".npy": b"\x93NUMPY", ".npz": ZIP}
"""How every file of these formats begins, which are those of several representations."""

_SHOWN = 12  # bytes of a beginning in a message


def user_path(source: str | os.PathLike[str]) -> Path:
    """The path, with ~ as the home directory; a path that cannot have one stays as it is."""
    path = Path(source)
    try:
        return path.expanduser()
    except RuntimeError:  # no home directory, or no user of that name
        return path


def existing_file(source: str | os.PathLike[str]) -> Path:
    """The path, if it names a readable file with content.

    Raises:
        ReadError: if it is missing, a directory, empty or not readable.
    """
    path = user_path(source)
    if path.is_dir():
        raise ReadError(f"{path} is a directory; give one of its files, or examine all of them with topokit.survey.")
    if not path.exists():
        raise ReadError(f"{path} does not exist (looked in {Path.cwd()}).")
    if not path.is_file():
        raise ReadError(f"{path} is not a regular file.")
    if path.stat().st_size == 0:
        raise ReadError(f"{path} is empty (0 bytes); export it again.")
    if not os.access(path, os.R_OK):
        raise ReadError(f"{path} is not readable by this user; check its permissions.")
    return path


def require_beginning(path: Path) -> None:
    """Refuse a file that does not begin as all files of its suffix do.

    Raises:
        ReadError: if it does not.
    """
    expected, start = BEGINNINGS.get(path.suffix.lower(), b""), head(path, _SHOWN)
    if not start.startswith(expected):
        raise ReadError(
            f"{path} begins with {start!r}, and a {path.suffix.lower()} file with {expected!r}: it is damaged, or "
            "something else under that name. Export it again, or rename it to what it is."
        )


def head(path: Path, size: int = HEAD) -> bytes:
    """The first bytes of a file, or of what a gzip file holds; of a broken gzip file its own; none of a directory."""
    if path.is_dir():
        return b""
    with path.open("rb") as file:
        beginning = file.read(size)
    if not beginning.startswith(GZIP):
        return beginning
    try:
        with gzip.open(path) as packed:
            return packed.read(size)
    except (OSError, EOFError, zlib.error):
        return beginning


def member_names(path: Path) -> list[str] | None:
    """The names in a zip archive; None if it is none, or damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except (zipfile.BadZipFile, OSError, NotImplementedError, ValueError):
        return None


def file_beside(path: Path, name: str) -> Path:
    """The file that a file names as a part of itself.

    Args:
        path: the given file.
        name: what it names: relative, with / between folders.

    Raises:
        ReadError: if that is outside the given file's folder, be it by an absolute path, by "..", as an address of the
            net or through a link; or if it is missing.
    """
    if PurePosixPath(name).is_absolute() or "\\" in name or ":" in name:
        raise ReadError(_elsewhere(path, name))
    return require_beside(path, path.resolve().parent / name)


def require_beside(path: Path, place: Path) -> Path:
    """A file that belongs to the given one, with links resolved.

    Args:
        path: the given file.
        place: of the other one.

    Raises:
        ReadError: if that is outside the given file's folder, by ".." or through a link; or if it is missing.
    """
    found = place.resolve()
    if not found.is_relative_to(path.resolve().parent):
        raise ReadError(_elsewhere(path, place.name))
    return existing_file(found)


def _elsewhere(path: Path, name: str) -> str:
    return f"{path} refers to {name!r}, which is not in its folder: it is not opened."
