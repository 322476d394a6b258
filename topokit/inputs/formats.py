"""The formats of a representation as rows of one table, and which of them a file has: by content, else by suffix.

A row says how a format is recognized, who reads it and what that needs. A table imports no reader: it names them. Which
representation a file is, if several could read it, is decided in `topokit.plugins.adapter_choice`.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from topokit.inputs.files import GZIP, HEAD, head

Recognizer = Callable[[Path, bytes], bool]


class Format(NamedTuple):
    """One format of files.

    Attributes:
        name: of its reader, in messages.
        suffixes: those that choose the adapter of this table.
        recognizes: whether a file is of this format, by its path and first bytes. The first row that does is taken.
        read: the function of a path that reads a file as a whole, as "package.module:function"; None if `stored` does.
        stored: likewise what gives something that can be read part by part, or None for files that cannot; other
            arguments are passed on. None if no file of this format can be read so.
        requires: modules that must be installed.
        is_certain: whether a file of this format is of this representation beyond doubt, by the same; None if all are.
    """

    name: str
    suffixes: tuple[str, ...]
    recognizes: Recognizer
    read: str | None = None
    stored: str | None = None
    requires: tuple[str, ...] = ()
    is_certain: Recognizer | None = None


Formats = tuple[Format, ...]


def begins(*starts: bytes) -> Recognizer:
    """A recognizer of files that begin with one of these bytes."""
    return lambda path, beginning: beginning.startswith(starts)


def called(*suffixes: str) -> Recognizer:
    """A recognizer of files with one of these suffixes, also before .gz."""
    return lambda path, beginning: path.name.lower().removesuffix(".gz").endswith(suffixes)


def never(path: Path, beginning: bytes) -> bool:
    """A recognizer of nothing: of formats that only their suffix tells, and of content that many have."""
    return False


def by_suffix(formats: Formats, path: Path) -> Format | None:
    """The format whose suffix a file has, or None: for files whose content is that of no format."""
    return next((one for one in formats if path.suffix.lower() in one.suffixes), None)


def format_of(formats: Formats, path: Path, *, else_by_suffix: bool = False) -> Format | None:
    """The format of a file or folder, or None.

    The content chooses it; some recognizers look at the suffix, too.

    Args:
        formats: a table.
        path: the file.
        else_by_suffix: whether the suffix chooses where the content is that of no format.
    """
    found = _recognized(formats, path, head(path))
    return by_suffix(formats, path) if found is None and else_by_suffix else found


def _recognized(formats: Formats, path: Path, beginning: bytes) -> Format | None:
    return next((one for one in formats if one.recognizes(path, beginning)), None)


def is_certainly(formats: Formats, path: Path) -> bool:
    """Whether the content of a file or folder leaves no doubt that it is of the table's representation."""
    beginning = head(path)
    found = _recognized(formats, path, beginning)
    return found is not None and (found.is_certain is None or found.is_certain(path, beginning))


def stored_in(formats: Formats, path: Path, *given: Any) -> Any | None:
    """What can be read of an existing file or folder part by part; None if it can be read only as a whole.

    That is so for all that gzip packed, which `head` would look into.

    Args:
        formats: a table.
        path: the file.
        given: other arguments of `Format.stored`.
    """
    beginning = b""
    if path.is_file():
        with path.open("rb") as file:
            beginning = file.read(HEAD)
    found = None if beginning.startswith(GZIP) else _recognized(formats, path, beginning)
    return None if found is None or found.stored is None else pkgutil.resolve_name(found.stored)(path, *given)


def suffixes_of(formats: Iterable[Format]) -> tuple[str, ...]:
    """All suffixes."""
    return tuple(suffix for one in formats for suffix in one.suffixes)


def requirements_of(formats: Iterable[Format]) -> tuple[tuple[str, str], ...]:
    """(suffix, module) pairs, as `Adapter.suffix_requires` has them."""
    return tuple((suffix, module) for one in formats for module in one.requires for suffix in one.suffixes)
