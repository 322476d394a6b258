"""Headers that say what files of several representations hold: those of .ply, .npy and .npz."""

from __future__ import annotations

import math
import os
import re
import tokenize
import zipfile
from pathlib import Path
from typing import Any, Literal

from topokit.errors import ReadError
from topokit.inputs.files import BEGINNINGS, ZIP
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import require_bytes, require_members
from topokit.inputs.unpacking import unpacked

NUMPY = BEGINNINGS[".npy"]


def numpy_kind(path: Path, beginning: bytes) -> Literal["points", "volume"] | None:
    """What a .npy or .npz file holds by its headers; None if it is no such file.

    An array of three axes or more is a volume, unless the archive names points. A damaged file counts as points: their
    reader reports it.
    """
    if not beginning.startswith(NUMPY) and not (beginning.startswith(ZIP) and b".npy" in beginning):
        return None
    try:
        with unpacked(path) as plain:
            shapes = array_shapes(plain)
    except ReadError:
        return "points"
    return "volume" if "points" not in shapes and any(len(shape) >= 3 for shape in shapes.values()) else "points"


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
                    require_members(path, [entry])
                    with archive.open(entry) as member:
                        shapes[name.removesuffix(".npy").lower()] = _array_shape(member, path, entry.file_size)
    return shapes


def _array_shape(file: Any, path: Path, size: int) -> tuple[int, ...]:
    """The shape in the header of an array, which must fit into `size` bytes."""
    from numpy.lib import format as npy

    if npy.read_magic(file) == (1, 0):
        read = npy.read_array_header_1_0
    else:
        length, read = file.read(4), npy.read_array_header_2_0
        require_bytes(path, "its own header", int.from_bytes(length, "little"), size)
        file.seek(-len(length), os.SEEK_CUR)
    with reading(path, "NumPy", TypeError):  # of keys that cannot be sorted
        shape, _, dtype = read(file)
    require_bytes(path, f"an array of shape {shape}", math.prod(shape) * dtype.itemsize, size)
    return tuple(shape)


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
    """Names of the scalar properties in the header of a .ply file."""
    header = beginning.partition(b"end_header")[0]
    return set(re.findall(rb"^property\s+\w+\s+(\w+)\s*$", header, re.MULTILINE))
