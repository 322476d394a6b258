"""Files that belong to the given one: only those in its own folder, or in folders there, are ever opened."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from topokit.errors import ReadError
from topokit.inputs.files import existing_file


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
