"""MRC and CCP4 maps of electron microscopy, through mrcfile."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.core.grid.placement import Placement
from topokit.errors import requiring
from topokit.inputs.files import head
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import require_bytes

_HEADER = 1024  # bytes
_EXTENDED, _STAMP = slice(92, 96), slice(212, 213)  # the size of the extended header, and the order of bytes
_BIG_ENDIAN = b"\x11"


def read_mrc(path: Path) -> tuple[NDArray[Any], Placement | None]:
    """Values in the order of sections, rows and columns, mostly Z, Y, X; places in Ångström.

    The first voxel is at the header's origin, or by its start indices where the origin is zero.

    Raises:
        ReadError: if the file is malformed.
        MissingDependencyError: without mrcfile.
    """
    with requiring(f'Reading {path.name} needs mrcfile: pip install "topokit[volumes]".'):
        import mrcfile
        from mrcfile.utils import data_dtype_from_header, data_shape_from_header
    with reading(path, "mrcfile"):
        size, start = path.stat().st_size - _HEADER, head(path, _HEADER)
        extended = int.from_bytes(start[_EXTENDED], "big" if start[_STAMP] == _BIG_ENDIAN else "little")
        require_bytes(path, f"an extended header of {extended} bytes", extended, size)
        with mrcfile.open(path, header_only=True) as file:
            header = file.header
            shape, kind = data_shape_from_header(header), data_dtype_from_header(header)
        needed = math.prod(abs(int(length)) for length in shape) * kind.itemsize
        require_bytes(path, f"a map of shape {shape}", needed, size - extended)
        with mrcfile.open(path) as file:
            return file.data, _placement(header)


def _placement(header: Any) -> Placement | None:
    """Where the voxels are by a header; None if it has no cell, or names an axis twice."""
    axes = [int(header[name]) - 1 for name in ("maps", "mapr", "mapc")]
    if sorted(axes) != [0, 1, 2]:
        return None
    counts = np.array([header.mx, header.my, header.mz], dtype=float)
    cell, origin = (np.array(header[name].tolist(), dtype=float) for name in ("cella", "origin"))
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = cell / counts
    starts = np.empty(3)
    starts[axes] = [header.nzstart, header.nystart, header.nxstart]
    affine = np.eye(4)
    affine[:3, :3] = (np.eye(3) * steps)[:, axes]
    affine[:3, 3] = origin if origin.any() else starts * steps
    return Placement.of_affine(affine, "Å")
