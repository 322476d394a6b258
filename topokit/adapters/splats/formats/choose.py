"""Which reader opens a splat file: by content where that is conclusive, else by suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from topokit.adapters.splats.entry import SPLATS, Format, format_by_content
from topokit.adapters.splats.formats.compressed_ply import read_compressed_ply
from topokit.adapters.splats.formats.ksplat import read_ksplat
from topokit.adapters.splats.formats.ply import read_ply
from topokit.adapters.splats.formats.sog import read_sog
from topokit.adapters.splats.formats.splat import read_splat
from topokit.adapters.splats.formats.spz import read_spz
from topokit.adapters.splats.formats.table import CONVERTER, SplatTable
from topokit.errors import UnknownFormatError
from topokit.inputs.files import head
from topokit.inputs.reading import reading
from topokit.inputs.unpacking import unpacked

_READERS: dict[Format, Callable[[Path], SplatTable]] = {
    "ply": read_ply,
    "compressed ply": read_compressed_ply,
    "splat": read_splat,
    "spz": read_spz,
    "sog": read_sog,
    "ksplat": read_ksplat,
}
_BY_SUFFIX: dict[str, Format] = {".splat": "splat", ".spz": "spz", ".sog": "sog", ".ksplat": "ksplat"}


def read_splats(path: Path) -> SplatTable:
    """Splats of a file in any of the known formats.

    Raises:
        UnknownFormatError: if neither content nor suffix is that of a splat format.
        ReadError: if the file is malformed.
        MissingDependencyError: if the format needs a package that is not installed.
    """
    if format_by_content(path) == "spz":  # which is a gzip file of its own
        return _read(path)
    with unpacked(path) as plain:
        return _read(plain)


def _read(path: Path) -> SplatTable:
    name = format_by_content(path) or _format_by_suffix(path)
    with reading(path, f"the .{name} reader"), np.errstate(all="ignore"):  # what overflows is dropped and counted
        return _READERS[name](path)


def _format_by_suffix(path: Path) -> Format:
    suffix = path.suffix.lower()
    if suffix == ".ply" or head(path).startswith(b"ply\n"):
        raise UnknownFormatError(
            f"{path} is a .ply file without Gaussian splats (no scale_0, rot_0 … or packed_position); "
            "open it with topokit.load, from_mesh or from_points."
        )
    if suffix in _BY_SUFFIX:
        return _BY_SUFFIX[suffix]
    raise UnknownFormatError(
        f"{path}: neither {repr(suffix) if suffix else 'its name'} nor its content is a known splat format. "
        f"Known: {', '.join(SPLATS.suffixes)}, or the folder of an unzipped .sog. {CONVERTER}"
    )
