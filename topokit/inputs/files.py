"""Looking at a path before anybody reads it."""

from __future__ import annotations

import gzip
import math
import os
import re
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Literal

from topokit.errors import ReadError
from topokit.inputs.reading import reading, require_bytes, require_expansion

HEAD = 1 << 16  # bytes that tell one format from another
ZIP, GZIP, NUMPY = b"PK\x03\x04", b"\x1f\x8b", b"\x93NUMPY"
_heads_read: ContextVar[dict[Path, bytes] | None] = ContextVar("heads_read", default=None)


def existing_file(source: str | os.PathLike[str]) -> Path:
    """The path, if it names a readable file with content.

    Raises:
        ReadError: if it is missing, a directory, empty or not readable.
    """
    path = Path(source)
    if path.is_dir():
        raise ReadError(f"{path} is a directory; give the files in it one by one.")
    if not path.exists():
        raise ReadError(f"{path} does not exist (looked in {Path.cwd()}).")
    if not path.is_file():
        raise ReadError(f"{path} is not a regular file.")
    if path.stat().st_size == 0:
        raise ReadError(f"{path} is empty (0 bytes); export it again.")
    if not os.access(path, os.R_OK):
        raise ReadError(f"{path} may not be read by this user; check its permissions.")
    return path


def file_of_folder(source: str | os.PathLike[str]) -> Path:
    """The path itself, or for the folder of an unzipped .sog the meta.json in it."""
    path = Path(source)
    return path / "meta.json" if (path / "meta.json").is_file() else path


def head(path: Path, size: int = HEAD) -> bytes:
    """The first bytes of a file; none of a directory."""
    if path.is_dir():
        return b""
    known = _heads_read.get()
    if known is None or size > HEAD:
        with path.open("rb") as file:
            return file.read(size)
    if path not in known:
        with path.open("rb") as file:
            known[path] = file.read(HEAD)
    return known[path][:size]


@contextmanager
def heads_read_once() -> Iterator[None]:
    """Whoever asks for a `head` in this block gets what was read the first time."""
    token = _heads_read.set({})
    try:
        yield
    finally:
        _heads_read.reset(token)


def unpacked_head(path: Path, size: int = HEAD) -> bytes:
    """The first bytes of a file, or of what a gzip file holds; of a broken gzip file its own."""
    beginning = head(path, size)
    if beginning.startswith(GZIP):
        try:
            with gzip.open(path) as file:
                return file.read(size)
        except (OSError, EOFError, zlib.error):
            return beginning
    return beginning


def ply_kind(beginning: bytes) -> Literal["mesh", "points", "splats"] | None:
    """What the header of a .ply file announces; None if the file is no .ply."""
    if not beginning.startswith(b"ply"):
        return None
    properties = ply_properties(beginning)
    if b"packed_position" in properties or {b"scale_0", b"scale_1", b"rot_3"} <= properties:
        return "splats"
    faces = re.search(rb"element\s+(?:face|tristrips)\s+(\d+)", beginning.partition(b"end_header")[0])
    return "mesh" if faces and int(faces.group(1)) > 0 else "points"


def ply_properties(beginning: bytes) -> set[bytes]:
    """Names of the plain properties in the header of a .ply file."""
    header = beginning.partition(b"end_header")[0]
    return set(re.findall(rb"^property\s+\w+\s+(\w+)\s*$", header, re.MULTILINE))


def numpy_kind(path: Path, beginning: bytes) -> Literal["points", "volume"] | None:
    """What a .npy or .npz file holds by its headers; None if it is no such file.

    A 3-D array is a volume, unless the archive names points. What is damaged counts as points, whose reader says so.
    """
    if not beginning.startswith(NUMPY) and not (beginning.startswith(ZIP) and b".npy" in beginning):
        return None
    try:
        shapes = array_shapes(path)
    except ReadError:
        return "points"
    return "volume" if "points" not in shapes and any(len(shape) == 3 for shape in shapes.values()) else "points"


def array_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Shapes of the arrays in a .npy or .npz file by lower-case name ("" for .npy), from their headers alone.

    Raises:
        ReadError: if it is malformed, or a header announces more than the file holds.
    """
    shapes = {}
    damaged = (NotImplementedError, RuntimeError, SyntaxError, tokenize.TokenError)  # of zipfile and of numpy's parser
    with reading(path, "the NumPy reader", *damaged):
        if not zipfile.is_zipfile(path):
            with path.open("rb") as file:
                return {"": _array_shape(file, path, path.stat().st_size)}
        with zipfile.ZipFile(path) as archive:
            for entry in archive.infolist():
                name = entry.filename
                if name.endswith(".npy"):
                    require_expansion(path, entry.file_size, path.stat().st_size)
                    with archive.open(entry) as member:
                        shapes[name.removesuffix(".npy").lower()] = _array_shape(member, path, entry.file_size)
    return shapes


def _array_shape(file: Any, path: Path, size: int) -> tuple[int, ...]:
    """The shape in the header of an array, which must fit into `size` bytes."""
    from numpy.lib import format as npy

    read = npy.read_array_header_1_0 if npy.read_magic(file) == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(file)
    require_bytes(path, f"an array of shape {shape}", math.prod(shape) * dtype.itemsize, size)
    return tuple(shape)
