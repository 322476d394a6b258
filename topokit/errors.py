"""The errors topokit raises: each says what came, what was expected and what to do."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager


class TopokitError(Exception):
    """Base class of every error that topokit raises on purpose."""


class InputError(TopokitError, ValueError):
    """The data given cannot be used: wrong shape, wrong type, too few points, not finite."""


class ReadError(TopokitError, OSError):
    """A file is missing, unreadable, truncated or not what its content claims to be."""


class UnknownFormatError(TopokitError, ValueError):
    """Neither content nor suffix names a format that topokit knows."""


class MissingDependencyError(TopokitError, ImportError):
    """An optional package is needed; the message holds the line that installs it."""


class AdapterError(TopokitError, RuntimeError):
    """An adapter broke its promise: it could not be imported, failed while opening, or returned what is no `Shape`."""


class AdapterWarning(UserWarning):
    """A plug-in is broken; it is left out, and everything else works."""


class GenusError(TopokitError, ValueError):
    """Genus has no meaning for this surface (open, non-manifold, not orientable) or is not known."""


# What third-party readers raise on malformed files. Programming errors of ours (NameError, ...) are left out.
_READER_ERRORS: tuple[type[Exception], ...] = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    NotImplementedError,
    OSError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)


@contextmanager
def reading(path: object, reader: str, *own_errors: type[Exception], extra: str | None = None) -> Iterator[None]:
    """Turn whatever a third-party reader raises on a broken file into a `ReadError` that names file and reader.

    Args:
        path: the file, for the message.
        reader: who reads it, for the message.
        own_errors: exception classes of the reader's own.
        extra: what to install if the reader lacks a package. Without it its ImportError passes, and `load` names the
            adapter's own `extra`.

    Raises:
        ReadError: instead of the reader's own exception, which stays attached as the cause.
        MissingDependencyError: if the reader lacks a package of its own, and `extra` is given.
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
    except (*_READER_ERRORS, *own_errors) as error:
        raise ReadError(
            f"{path} could not be read by {reader} ({summary(error)}). "
            "The file seems to be truncated or malformed; export it again or check it in another program."
        ) from error


def summary(error: BaseException | None) -> str:
    """An exception's class and what it says, in one short line."""
    said = " ".join(str(error).split())[:200] or "no message"
    return f"{type(error).__name__}: {said}"
