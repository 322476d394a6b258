"""Which reader opens a splat file: by content where that is conclusive, else by suffix."""

from __future__ import annotations

import pkgutil
from pathlib import Path

import numpy as np

from topokit.adapters.splats.entry import FORMATS, SPLATS
from topokit.adapters.splats.formats.splat_table import CONVERTER, SplatTable
from topokit.errors import UnknownFormatError
from topokit.inputs.files import head
from topokit.inputs.formats import Format, by_suffix, format_of
from topokit.inputs.reading import reading
from topokit.inputs.unpacking import unpacked


def read_splats(path: Path) -> SplatTable:
    """Splats of a file in any of the known formats.

    Raises:
        UnknownFormatError: if neither content nor suffix is that of a splat format.
        ReadError: if the file is malformed.
        MissingDependencyError: if the format needs a package that is not installed.
    """
    found = format_of(FORMATS, path)
    if found is not None and found.name == "spz":  # which is a gzip file of its own
        return _read(path)
    with unpacked(path) as plain:
        return _read(plain)


def _read(path: Path) -> SplatTable:
    found = format_of(FORMATS, path) or _format_by_suffix(path)
    with reading(path, f"the .{found.name} reader"), np.errstate(all="ignore"):  # what overflows is dropped and counted
        table: SplatTable = pkgutil.resolve_name(str(found.read))(path)
        return table


def _format_by_suffix(path: Path) -> Format:
    suffix = path.suffix.lower()
    if suffix == ".ply" or head(path).startswith(b"ply\n"):
        raise UnknownFormatError(
            f"{path} is a .ply file without Gaussian splats (no scale_0, rot_0 … or packed_position); "
            "open it with topokit.load, from_mesh or from_points."
        )
    if (found := by_suffix(FORMATS, path)) is not None:
        return found
    raise UnknownFormatError(
        f"{path}: neither {repr(suffix) if suffix else 'its name'} nor its content is a known splat format. "
        f"Known: {', '.join(SPLATS.suffixes)}, or the folder of an unzipped .sog. {CONVERTER}"
    )
