"""What is no plain file on the disk as one: the content of gzip files, bytes and file objects."""

from __future__ import annotations

import gzip
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from topokit.ending import finally_do
from topokit.errors import InputError, TopokitError
from topokit.inputs.files import GZIP, existing_file
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import FREE_OF_MASKS, require_expansion

_STEP = 1 << 20  # bytes copied at a time
FORBIDDEN = set('/\\:*?"<>|\0')
"""Letters that a file's name may not have, on one platform or another."""

_folders: set[Path] = set()  # of temporary files


def is_content(source: object) -> bool:
    """Whether this is bytes or a file object, rather than a path or a shape."""
    is_file = all(callable(getattr(source, name, None)) for name in ("read", "close"))
    return isinstance(source, bytes | bytearray | memoryview) or is_file


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """The file itself, or during the block a file with what a gzip file holds, named without its .gz.

    Raises:
        ReadError: if it is a damaged gzip file, or expands to an absurd size.
    """
    if not path.is_file() or not _is_gzip(path):
        yield path
        return

    def unpack(target: BinaryIO) -> None:
        size, written = path.stat().st_size, 0
        with reading(path, "gzip"), gzip.open(path) as packed:
            while part := packed.read(_STEP):
                written += len(part)
                require_expansion(path, written, size, FREE_OF_MASKS)
                target.write(part)

    with temporary_file(path.name[:-3] if path.name.lower().endswith(".gz") else path.name, str(path), unpack) as plain:
        yield existing_file(plain)


@contextmanager
def kept_in_file(content: Any, format: str | None) -> Iterator[Path]:
    """During the block a file with these bytes, or with what is left to read of a file object.

    Args:
        content: bytes, or an object with `read`, in binary or text mode.
        format: suffix of the file, as "stl" or ".nii.gz"; None takes that of the file object's name, if it has one.

    Raises:
        InputError: if the format is no suffix, or there is nothing to read.
    """
    name = _name_of(content)
    if format is not None:
        suffix = format.lstrip(".").lower()
        if not suffix or FORBIDDEN & set(suffix):
            raise InputError(f"format is {format!r}; expected the suffix of a file, such as 'stl' or 'nii.gz'.")
        name = name if name.lower().endswith(f".{suffix}") else f"{name}.{suffix}"

    def write(target: BinaryIO) -> None:
        if isinstance(content, bytes | bytearray | memoryview):
            target.write(content)
        else:
            _copy(content, target)
        if target.tell() == 0:
            raise InputError(f"{name} holds no bytes: a file object may have been read to its end; call seek(0) first.")

    with temporary_file(name, name, write) as path:
        yield path


def is_temporary(path: Path) -> bool:
    """Whether a file is there only as long as it is opened: what gzip packed, bytes held, or an address named."""
    return path.absolute().parent in _folders


def _is_gzip(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(GZIP)) == GZIP


def _name_of(content: Any) -> str:
    """The name of a file object's file, or "data"."""
    name = getattr(content, "name", None)
    base = Path(name).name if isinstance(name, str) else ""
    return base if base and not FORBIDDEN & set(base) else "data"


def _copy(source: Any, target: BinaryIO) -> None:
    while part := source.read(_STEP):
        if not isinstance(part, str | bytes):
            raise InputError(f"read() of {type(source).__name__} gave {type(part).__name__}; bytes were expected.")
        target.write(part.encode() if isinstance(part, str) else part)


@contextmanager
def temporary_file(name: str, called: str, write: Callable[[BinaryIO], None]) -> Iterator[Path]:
    """A file in a folder of its own, which is gone after the block; errors name it as it is called."""
    folder = Path(tempfile.mkdtemp(prefix="topokit-"))
    path = folder / name
    _folders.add(folder)
    ignored = os.name == "nt"  # Windows keeps files that are still mapped into memory
    with finally_do(partial(shutil.rmtree, folder, ignore_errors=ignored)):
        try:
            with path.open("wb") as file:
                write(file)
            yield path
        except TopokitError as error:
            error.rename(str(path), called)
            raise
        finally:
            _folders.discard(folder)
