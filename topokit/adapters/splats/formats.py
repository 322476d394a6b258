"""Which reader a splat file asks for: by content where that is conclusive, else by suffix."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from topokit.adapters.splats.compressed_ply import read_compressed_ply
from topokit.adapters.splats.ksplat import read_ksplat, starts_ksplat
from topokit.adapters.splats.ply import read_ply
from topokit.adapters.splats.sog import read_sog
from topokit.adapters.splats.splat import read_splat
from topokit.adapters.splats.spz import read_spz, starts_spz
from topokit.adapters.splats.table import CONVERTER, SplatTable
from topokit.errors import UnknownFormatError, reading
from topokit.files import head

Reader = Callable[[Path], SplatTable]
SUFFIXES = (".ply", ".splat", ".spz", ".sog", ".ksplat")
HEAD = 1 << 16  # bytes that tell one format from another


def read_splats(path: Path) -> SplatTable:
    """Splats of a file in any of the known formats.

    Raises:
        UnknownFormatError: if neither content nor suffix is that of a splat format.
        ReadError: if the file is malformed.
        MissingDependencyError: if the format needs a package that is not installed.
    """
    beginning = head(path, HEAD)
    reader = reader_by_content(path, beginning) or _reader_by_suffix(path, beginning)
    kind = reader.__name__.removeprefix("read_").replace("_", " ")
    with reading(path, f"the .{kind} reader"), np.errstate(all="ignore"):  # what overflows is dropped and counted
        return reader(path)


def reader_by_content(path: Path, beginning: bytes) -> Reader | None:
    """The reader whose format the content shows, or None if the content shows none.

    Args:
        path: the file.
        beginning: its first `HEAD` bytes.
    """
    if beginning.startswith(b"ply"):
        return _ply_reader(beginning.partition(b"end_header")[0])
    if beginning.startswith(b"PK\x03\x04"):
        return read_sog if _is_sog_archive(path) else None
    if re.match(rb"\s*\{", beginning):
        return read_sog if b'"means"' in beginning and b'"quats"' in beginning else None
    if starts_spz(beginning):
        return read_spz
    return read_ksplat if starts_ksplat(beginning) else None


def _ply_reader(header: bytes) -> Reader | None:
    properties = set(re.findall(rb"^property\s+\w+\s+(\w+)\s*$", header, re.MULTILINE))
    if b"packed_position" in properties:
        return read_compressed_ply
    return read_ply if {b"scale_0", b"scale_1", b"rot_3"} <= properties else None


def _is_sog_archive(path: Path) -> bool:
    """Whether a zip archive holds a meta.json: 3MF, NumPy and office files do not."""
    try:
        with zipfile.ZipFile(path) as archive:
            return any(name.rpartition("/")[2] == "meta.json" for name in archive.namelist())
    except (zipfile.BadZipFile, OSError, NotImplementedError, ValueError):
        return path.suffix.lower() == ".sog"  # its reader says what is wrong with it


def _reader_by_suffix(path: Path, beginning: bytes) -> Reader:
    suffix = path.suffix.lower()
    if suffix == ".ply" or beginning.startswith(b"ply\n"):
        raise UnknownFormatError(
            f"{path} is a .ply file without Gaussian splats (no scale_0, rot_0 … or packed_position); "
            "open it with topokit.load, from_mesh or from_points."
        )
    if suffix in _BY_SUFFIX:
        return _BY_SUFFIX[suffix]
    raise UnknownFormatError(
        f"{path}: {suffix or 'a file without suffix'!r} is not a known splat format and its content is not one either. "
        f"Known: {', '.join(SUFFIXES)}, or the folder of an unzipped .sog. {CONVERTER}"
    )


_BY_SUFFIX: dict[str, Reader] = {".splat": read_splat, ".spz": read_spz, ".sog": read_sog, ".ksplat": read_ksplat}
