"""Addresses instead of paths: s3://, https://, zip://, memory:// and whatever else fsspec opens.

A file at an address is copied into a temporary one while it is read. Nothing is fetched but what the caller names: what
a file names is looked for beside it alone (see `beside`), where a copy has no neighbors. Volumes of zarr are not
copied: zarr reads the chunks that are asked for.
"""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial, wraps
from inspect import signature
from pathlib import Path
from typing import Any, BinaryIO, ParamSpec, TypeVar
from urllib.parse import urlsplit

from topokit.errors import InputError, MissingDependencyError, ReadError, TopokitError, requiring, summary
from topokit.inputs.size_limits import FREE_OF_MASKS, require_expansion
from topokit.inputs.unpacking import FORBIDDEN, temporary_file

Options = ParamSpec("Options")
Result = TypeVar("Result")

_ADDRESS = re.compile(r"([A-Za-z][\w+.-]+::)*[A-Za-z][\w+.-]+://")  # a drive has one letter
_STEP = 1 << 20  # bytes copied at a time
_SHARE = 2  # of the free disk a copy may take one half
_ERRORS: tuple[type[Exception], ...] = (
    EOFError,
    LookupError,  # no such member of an archive
    NotImplementedError,
    OSError,
    RuntimeError,  # a member of an archive is encrypted
    ValueError,
    zipfile.BadZipFile,
    zlib.error,
)


def is_address(source: object) -> bool:
    """Whether this is a text like s3://bucket/part.stl or zip://part.stl::https://example.org/parts.zip."""
    return isinstance(source, str) and _ADDRESS.match(source) is not None


def lies_in(source: object, suffixes: tuple[str, ...]) -> bool:
    """Whether this is the address of a folder with one of these suffixes, or of something in one."""
    if not isinstance(source, str) or not is_address(source):
        return False
    return any(part.lower().endswith(suffixes) for part in _place(source).split("/"))


@contextmanager
def fetched(address: str) -> Iterator[Path]:
    """During the block a file with what is at an address, under the name that it has there.

    Raises:
        MissingDependencyError: if fsspec is not installed, or what it needs for such addresses.
        ReadError: if there is nothing at the address, or a folder; or it expands to an absurd size, or is too large for
            half of the free disk.
    """
    name = _place(address).rstrip("/").rpartition("/")[2]
    name = name if name.strip(".") and not FORBIDDEN & set(name) else "data"
    with temporary_file(name, address, partial(_copy, address)) as path:
        if path.stat().st_size == 0:
            raise ReadError(f"{address} is empty (0 bytes); export it again.")
        yield path


def takes_addresses(
    suffixes: tuple[str, ...] = (),
) -> Callable[[Callable[Options, Result]], Callable[Options, Result]]:
    """A decorator of an opener, a function whose first argument may be a path, which then may be an address.

    Args:
        suffixes: of folders whose addresses the opener takes itself; of others it is given the path of a copy.
    """

    def decorate(opener: Callable[Options, Result]) -> Callable[Options, Result]:
        first = next(iter(signature(opener).parameters))

        @wraps(opener)
        def open_it(*args: Options.args, **options: Options.kwargs) -> Result:
            source = args[0] if args else options.get(first)
            if not isinstance(source, str) or not is_address(source) or lies_in(source, suffixes):
                return opener(*args, **options)
            with fetched(source) as path:
                if args:
                    return opener(path, *args[1:], **options)  # type: ignore[arg-type]
                return opener(*args, **{**options, first: path})  # type: ignore[arg-type]

        return open_it

    return decorate


def matching_addresses(pattern: str) -> list[str]:
    """The addresses that a pattern with * stands for, sorted; the pattern itself if there are none.

    Raises:
        MissingDependencyError, ReadError: as for `fetched`.
    """
    if "::" in pattern:
        raise InputError(f"{pattern} is a pattern within an archive or a cache; name the files one by one.")
    with asking(pattern):
        system, place = _fsspec().core.url_to_fs(pattern)
        found = [system.unstrip_protocol(one) for one in sorted(system.glob(place))]
    return found or [pattern]


@contextmanager
def asking(address: str) -> Iterator[None]:
    """Turn what fsspec raises into errors that name the address; refuse addresses that only list other places."""
    if any(part.partition("://")[0].lower() == "reference" for part in address.split("::")):
        raise ReadError(f"{address} lists pieces of other files, which are not opened: give the files themselves.")
    try:
        yield
    except TopokitError:
        raise
    except ImportError as error:
        raise MissingDependencyError(f"{address} needs a package that is not installed ({summary(error)}).") from error
    except FileNotFoundError as error:
        raise ReadError(f"{address} does not exist ({summary(error)}).") from error
    except (*_ERRORS, *client_errors()) as error:
        raise ReadError(f"{address} could not be read ({summary(error)}).") from error


def client_errors() -> tuple[type[Exception], ...]:
    """What the client of https:// raises besides the usual errors, if it has been loaded."""
    aiohttp = sys.modules.get("aiohttp")
    return () if aiohttp is None else (aiohttp.ClientError,)


def _place(address: str) -> str:
    """The path within the first part of an address, without what follows it."""
    first = next(part for part in address.split("::") if "://" in part)
    return urlsplit(first).netloc + urlsplit(first).path


def _copy(address: str, target: BinaryIO) -> None:
    for part in _parts(address):
        target.write(part)


def _parts(address: str) -> Iterator[bytes]:
    """What is at an address, piece by piece, within the bounds."""
    free, written = shutil.disk_usage(tempfile.gettempdir()).free, 0
    with asking(address):
        system, place = _fsspec().core.url_to_fs(address)
        about = system.info(place)
        if about.get("type") == "directory":
            raise ReadError(f"{address} is a folder; give the files in it one by one, or a pattern with *.")
        _require_room(address, about, about.get("size") or 0, free)
        opened: AbstractContextManager[BinaryIO] = system.open(place, "rb")
        with opened as source:
            while part := source.read(_STEP):
                written += len(part)
                _require_room(address, about, written, free)
                yield part


def _require_room(address: str, about: dict[str, Any], size: int, free: int) -> None:
    if about.get("compress_size") is not None:  # a member of a zip archive
        require_expansion(address, size, about["compress_size"], FREE_OF_MASKS)
    if size > free // _SHARE:
        raise ReadError(
            f"{address} has at least {size} bytes, and a copy may take half of the {free} bytes that are free where "
            "temporary files are kept: set TMPDIR to a larger disk."
        )


def _fsspec() -> Any:
    with requiring('Addresses need fsspec: pip install "topokit[cluster]".'):
        import fsspec
    return fsspec
