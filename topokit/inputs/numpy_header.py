"""The headers of .npy and .npz files: shapes of their arrays, and whether they hold points or a volume."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, Literal

from topokit.errors import ReadError, reading
from topokit.inputs.files import ZIP

NUMPY = b"\x93NUMPY"


def numpy_kind(path: Path, beginning: bytes) -> Literal["points", "volume"] | None:
    """What a .npy or .npz file holds by its headers; None if it is no such file.

    A 3-D array is a volume, unless the archive names points. A damaged file counts as points: their reader reports it.
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
        ReadError: if it is malformed.
    """
    shapes = {}
    with reading(path, "the NumPy reader"):
        if not zipfile.is_zipfile(path):
            with path.open("rb") as file:
                return {"": _array_shape(file)}
        with zipfile.ZipFile(path) as archive:
            for name in archive.namelist():
                if name.endswith(".npy"):
                    with archive.open(name) as member:
                        shapes[name.removesuffix(".npy").lower()] = _array_shape(member)
    return shapes


def _array_shape(file: Any) -> tuple[int, ...]:
    from numpy.lib import format as npy

    read = npy.read_array_header_1_0 if npy.read_magic(file) == (1, 0) else npy.read_array_header_2_0
    return tuple(read(file)[0])
