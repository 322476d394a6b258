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
    folder = path.resolve().parent
    place = (folder / name).resolve()
    if PurePosixPath(name).is_absolute() or "\\" in name or ":" in name or not place.is_relative_to(folder):
        raise ReadError(f"{path} refers to {name!r}, which is not in its folder: it is not opened.")
    return existing_file(place)
