"""Compressed LAS: what its table of chunks announces, before a reader believes it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from topokit.errors import ReadError, summary
from topokit.inputs.reading import require_bytes


def check_chunks(path: Path, offset_to_points: int) -> None:
    """Refuse a table of more chunks than the file has bytes: laz-rs allocates it at once, and ends the process.

    Args:
        path: a .laz file.
        offset_to_points: where its points begin, with the place of the table.

    Raises:
        ReadError: if there is no such table.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        place = _integer(file, offset_to_points)
        if place == -1:  # written as a stream: the place is at the end
            place = _integer(file, size - 8)
        if not 0 <= place <= size - 8:
            raise ReadError(f"{path} has no table of chunks at byte {place}: it is truncated. Download it again.")
        file.seek(place + 4)  # behind the version
        n_chunks = int.from_bytes(file.read(4), "little")
    require_bytes(path, f"{n_chunks} chunks of compressed points", n_chunks, size)


@contextmanager
def reading_laz(path: Path) -> Iterator[None]:
    """Turn errors of laz-rs, and its panics, which are no `Exception` in Python, into errors about the file.

    Raises:
        ReadError: instead of an error or a panic.
    """
    try:
        yield
    except _of_laz_rs() as error:
        raise ReadError(f"{path} could not be read by laz-rs ({summary(error)}): it is damaged.") from error


def _of_laz_rs() -> tuple[type[BaseException], ...]:
    """What the library raises; the class of panics is made with the first one, in a module that cannot be imported."""
    panics = [kind for kind in BaseException.__subclasses__() if kind.__module__ == "pyo3_runtime"]
    library = sys.modules.get("lazrs")  # laspy has imported it if it is there
    return tuple(panics) if library is None else (library.LazrsError, *panics)


def _integer(file: BinaryIO, at: int) -> int:
    file.seek(max(0, at))
    return int.from_bytes(file.read(8), "little", signed=True)
