"""The guards around readers: what damaged data raises becomes a ReadError, and bugs stay bugs."""

from __future__ import annotations

import gzip
import json
import struct
import zipfile
import zlib
from collections.abc import Callable

import pytest

from topokit.errors import MissingDependencyError, ReadError
from topokit.inputs.reading import reading


class OfALibrary(Exception):
    pass


def raise_import_error() -> None:
    raise ImportError("no module named 'zstd'")


@pytest.mark.parametrize(
    "damaged",
    [
        lambda: json.loads("{"),
        lambda: struct.unpack("<II", b"1234"),
        lambda: b"\xff".decode(),
        lambda: zlib.decompress(b"nothing"),
        lambda: gzip.decompress(gzip.compress(b"something")[:15]),
        lambda: zipfile.ZipFile(__file__),
        lambda: float(10**400),
    ],
)
def test_what_damaged_data_raises_becomes_a_read_error(damaged: Callable[[], object]) -> None:
    message = r"^scene\.abc could not be read by the abc reader \("
    with pytest.raises(ReadError, match=message) as caught, reading("scene.abc", "the abc reader"):
        damaged()
    assert caught.value.__cause__ is not None


@pytest.mark.parametrize(
    "bug",
    [
        *(TypeError, AttributeError, AssertionError, NameError, IndexError, KeyError, MemoryError),
        *(RuntimeError, RecursionError, NotImplementedError, ZeroDivisionError, OfALibrary),
    ],
)
def test_bugs_pass_unless_a_library_is_known_to_raise_them(bug: type[Exception]) -> None:
    with pytest.raises(bug), reading("scene.abc", "the abc reader"):
        raise bug("a bug")
    with pytest.raises(ReadError, match="a bug"), reading("scene.abc", "the abc reader", bug):
        raise bug("a bug")


def test_our_own_errors_pass_as_they_are() -> None:
    with pytest.raises(ReadError, match=r"^exactly this$"), reading("scene.abc", "the abc reader"):
        raise ReadError("exactly this")


def test_a_missing_package_is_named_with_what_installs_it() -> None:
    message, extra = r'zstd.*pip install "topokit\[splats\]"', "topokit[splats]"
    with pytest.raises(MissingDependencyError, match=message), reading("scene.abc", "the abc reader", extra=extra):
        raise_import_error()
    with pytest.raises(ImportError, match=r"^no module named 'zstd'$"), reading("scene.abc", "the abc reader"):
        raise_import_error()
