"""Guards around file readers: what they raise on damaged data becomes a `ReadError`."""

from __future__ import annotations

import logging
import struct
import threading
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager

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
