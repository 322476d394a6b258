"""Guards around file readers: damaged data becomes a `ReadError`, and no header is trusted with memory."""

from __future__ import annotations

import logging
import struct
import threading
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from topokit.errors import MissingDependencyError, ReadError, TopokitError, summary
from topokit.text import is_unicode

# What readers raise on damaged data. TypeError, AttributeError, LookupError and the like are bugs of the calling code
# and pass. A library that raises one of those on damaged files gets it named at the call.
_DATA_ERRORS: tuple[type[Exception], ...] = (
    EOFError,
    OSError,
    OverflowError,
    ValueError,  # also UnicodeDecodeError and json.JSONDecodeError
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)
_FREE = 1 << 28  # bytes that any compressed file may expand to
FREE_OF_MASKS = 1 << 30
"""Bytes that a compressed volume may expand to: masks of one organ in a whole body do so by a factor of 1000."""

_MOST_EXPANSION = 200  # real splat scenes and arrays expand 2 to 20 times


@contextmanager
def reading(path: object, reader: str, *library_errors: type[Exception], extra: str | None = None) -> Iterator[None]:
    """Turn what a reader raises on damaged data into a `ReadError` that names the file and the reader.

    Args:
        path: the file, for the message.
        reader: who reads it, for the message.
        library_errors: further exceptions that a library raises on damaged files. Keep the block around that library's
            call alone if these are as general as KeyError or TypeError.
        extra: what to install if the reader lacks a package. Without it the ImportError passes, and `load` names the
            adapter's own `extra`.

    Raises:
        ReadError: instead of the reader's exception, which stays attached as the cause.
        MissingDependencyError: if the reader lacks a package, and `extra` is given.
    """
    try:
        yield
    except TopokitError:
        raise
    except ImportError as error:
        if extra is None:
            raise
        raise MissingDependencyError(
            f"Reading {path} with {reader} needs a package that is not installed ({error}). "
            f'Install the readers: pip install "{extra}".'
        ) from error
    except (*_DATA_ERRORS, *library_errors) as error:
        if isinstance(error, UnicodeEncodeError) and not is_unicode(str(path)):
            raise ReadError(f"{path} has a name that is not UTF-8, which {reader} cannot open: rename it.") from error
        raise ReadError(
            f"{path} could not be read by {reader} ({summary(error)}). "
            "The file seems to be truncated or malformed; export it again or check it in another program."
        ) from error


@contextmanager
def quiet(logger: str) -> Iterator[None]:
    """During the block the messages of a library's logger are dropped, in this thread: our error says what matters."""
    here = threading.get_ident()

    def is_others(record: logging.LogRecord) -> bool:
        return record.thread != here

    found = logging.getLogger(logger)
    found.addFilter(is_others)
    try:
        yield
    finally:
        found.removeFilter(is_others)


def require_bytes(path: Path | str, what: str, needed: int, available: int) -> None:
    """Refuse a header that announces more than the file holds, before memory is allocated for it.

    Raises:
        ReadError: if `needed` exceeds `available`.
    """
    if needed > available:
        raise ReadError(
            f"{path} announces {what}, which takes at least {needed} bytes, but has {available} bytes for it: "
            "it is truncated or its header is wrong. Export or download it again."
        )


def most_expanded(packed: int, free: int = _FREE) -> int:
    """The bytes to which so many packed bytes may expand."""
    return max(free, _MOST_EXPANSION * packed)


def require_expansion(path: Path | str, needed: int, file_size: int, free: int = _FREE) -> None:
    """Refuse a small compressed file that expands to an absurd amount of memory.

    Raises:
        ReadError: if `needed` bytes are more than `free` (256 MiB) and more than 200 times the file's size.
    """
    if needed > most_expanded(file_size, free):
        raise ReadError(
            f"{path} has {file_size} bytes and announces content of {needed} bytes, more than {_MOST_EXPANSION} times "
            "its size: its header is wrong or it is a decompression bomb. Export or download it again."
        )


def require_members(path: Path, members: Iterable[zipfile.ZipInfo], free: int = _FREE) -> None:
    """Refuse members of a zip archive that claim more packed bytes than it has: they are allocated before any is read.

    Raises:
        ReadError: if they do, or expand to more than `free` bytes (256 MiB) and 200 times the archive's size.
    """
    found, size = list(members), path.stat().st_size
    packed = sum(member.compress_size for member in found)
    require_bytes(path, f"{len(found)} members of {packed} packed bytes", packed, size)
    require_expansion(path, sum(member.file_size for member in found), size, free)
