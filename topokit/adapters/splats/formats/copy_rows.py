"""Some splats of a file as a file of the same format, with every column that the file has."""

from __future__ import annotations

import gzip
import os
import zlib
from pathlib import Path

import numpy as np

from topokit.adapters.splats.entry import FORMATS, scene_file
from topokit.adapters.splats.formats.splat import ROW
from topokit.adapters.splats.formats.splat_table import CONVERTER
from topokit.adapters.splats.formats.spz import HEADER, layout_of
from topokit.core.arrays import Integers
from topokit.errors import InputError, UnknownFormatError
from topokit.inputs.files import GZIP, existing_file, head
from topokit.inputs.formats import format_of
from topokit.inputs.ply import ply_elements, write_ply
from topokit.inputs.writing import completed_file


def copy_rows(source: str | os.PathLike[str], rows: Integers, target: str | os.PathLike[str]) -> None:
    """Write some splats of a file with colors, harmonics and all other columns, bit by bit as they are.

    Args:
        source: a .ply of single numbers, a .splat, or an .spz of version 1 to 3.
        rows: (M,) indices of its splats.
        target: file to write, with the suffix of the source.

    Raises:
        InputError: if the target has another suffix, or its folder does not exist.
        UnknownFormatError: if the splats of the source cannot be taken apart without loss.
    """
    path, target = existing_file(scene_file(source)), Path(target)
    found = format_of(FORMATS, path)
    name = path.suffix.lower().lstrip(".") if found is None else found.name
    if name not in ("ply", "splat", "spz") or (name != "spz" and head(path).startswith(GZIP)):
        raise UnknownFormatError(
            f"{path}: single splats of this format ({name or 'unknown'}) cannot be written as they are; .ply, .splat "
            f"and .spz can. {CONVERTER}"
        )
    if target.suffix.lower() != f".{name}" or not target.parent.is_dir():
        raise InputError(f"{target} must end with .{name}, as {path.name} does, and lie in a folder that exists.")
    if name == "ply":
        elements = ply_elements(path)
        vertex = elements["vertex"][rows]
        write_ply(target, **elements | {"vertex": vertex.astype(vertex.dtype.newbyteorder("<"))})
        return
    content = np.fromfile(path, dtype=ROW)[rows].tobytes() if name == "splat" else _spz_rows(path, rows)
    with completed_file(target) as unfinished:
        unfinished.write_bytes(content)


def _spz_rows(path: Path, rows: Integers) -> bytes:
    """The same for a gzipped .spz: each of its attributes is one block of bytes. Extensions are left out."""
    packed = path.read_bytes()
    if not packed.startswith(GZIP):
        raise UnknownFormatError(f"{path} is .spz version 4, which is not written: save it as version 3. {CONVERTER}")
    content = zlib.decompress(packed, wbits=31)
    layout, at = layout_of(path, content), HEADER.size
    blocks = []
    for size in layout.sizes():
        block = np.frombuffer(content, dtype=np.uint8, count=size, offset=at)
        blocks.append(block.reshape(layout.n_splats, -1)[rows].tobytes() if size else b"")
        at += size
    magic, version, _, *others = HEADER.unpack_from(content)
    return gzip.compress(HEADER.pack(magic, version, len(rows), *others) + b"".join(blocks), mtime=0)
