"""Which reader a splat file asks for: by content where that is conclusive, else by suffix."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from topokit.adapters.splats.entry import Splats
from topokit.adapters.splats.formats.compressed_ply import read_compressed_ply
from topokit.adapters.splats.formats.ksplat import read_ksplat, starts_ksplat
from topokit.adapters.splats.formats.ply import read_ply
from topokit.adapters.splats.formats.sog import read_sog
from topokit.adapters.splats.formats.splat import read_splat
from topokit.adapters.splats.formats.spz import read_spz, starts_spz
from topokit.adapters.splats.formats.table import CONVERTER, SplatTable
from topokit.errors import UnknownFormatError
from topokit.inputs.files import ZIP, head, ply_kind, ply_properties
from topokit.inputs.reading import reading

Reader = Callable[[Path], SplatTable]


def read_splats(path: Path) -> SplatTable:
    """Splats of a file in any of the known formats.

    Raises:
        UnknownFormatError: if neither content nor suffix is that of a splat format.
        ReadError: if the file is malformed.
        MissingDependencyError: if the format needs a package that is not installed.
    """
    beginning = head(path)
    reader = reader_by_content(path, beginning) or _reader_by_suffix(path, beginning)
    kind = reader.__name__.removeprefix("read_").replace("_", " ")
    with reading(path, f"the .{kind} reader"), np.errstate(all="ignore"):  # what overflows is dropped and counted
        return reader(path)


def reader_by_content(path: Path, beginning: bytes) -> Reader | None:
    """The reader whose format the content shows, or None if the content shows none.

    Args:
        path: the file.
        beginning: its first `topokit.inputs.files.HEAD` bytes.
    """
    if ply_kind(beginning) == "splats":
        return read_compressed_ply if b"packed_position" in ply_properties(beginning) else read_ply
    if beginning.startswith(ZIP):
        return read_sog if _is_sog_archive(path) else None
    if re.match(rb"\s*\{", beginning):
        return read_sog if b'"means"' in beginning and b'"quats"' in beginning else None
    if starts_spz(beginning):
        return read_spz
    return read_ksplat if starts_ksplat(beginning) else None


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
        f"Known: {', '.join(Splats.suffixes)}, or the folder of an unzipped .sog. {CONVERTER}"
    )


_BY_SUFFIX: dict[str, Reader] = dict(
    zip(Splats.suffixes, (read_ply, read_splat, read_spz, read_sog, read_ksplat), strict=True)
)
