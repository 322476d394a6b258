"""Compressed .ply (PlayCanvas, SuperSplat): four packed integers per splat, ranges per chunk of 256."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.splats.formats.splat_table import Floats, SplatTable, with_largest
from topokit.errors import ReadError
from topokit.inputs.ply import ply_elements

_CHUNK = 256
_PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_RANGES = tuple(f"{end}_{kind}{axis}" for kind in ("", "scale_") for end in ("min", "max") for axis in "xyz")


def read_compressed_ply(path: Path) -> SplatTable:
    """Splats of a compressed .ply.

    Positions and log scales are 11-10-11 bits between the chunk's ends; rotations "smallest three" with 10 bits;
    opacity is the lowest byte of the color, already 0 … 1.

    Raises:
        ReadError: if elements or properties are missing, or counts and file size do not agree.

    Reference:
        https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/
    """
    elements = ply_elements(path)
    vertex = _rows(elements, "vertex", _PACKED, "u", path)
    chunk = _rows(elements, "chunk", _RANGES, "f", path)
    n_chunks = -(-len(vertex) // _CHUNK)
    if len(chunk) != n_chunks:
        raise ReadError(f"{path} has {len(chunk)} chunks for {len(vertex)} splats; expected {n_chunks}.")
    of_chunk = np.arange(len(vertex)) // _CHUNK
    rotation = vertex["packed_rotation"]
    thirds = np.stack([(rotation >> shift) & 1023 for shift in (20, 10, 0)], axis=1).astype(np.float32)
    return SplatTable(
        _lerp(vertex["packed_position"], chunk, "", of_chunk),
        np.exp(_lerp(vertex["packed_scale"], chunk, "scale_", of_chunk)),
        with_largest(rotation >> 30, (thirds / np.float32(1023) - np.float32(0.5)) * np.float32(np.sqrt(2))),
        (vertex["packed_color"] & 255).astype(np.float32) / np.float32(255),
    )


def _rows(
    elements: Mapping[str, NDArray[np.void]], name: str, needed: tuple[str, ...], kind: str, path: Path
) -> NDArray[np.void]:
    """The rows of an element that has the properties needed, all of four bytes and of one kind ("u" or "f")."""
    rows = elements.get(name, np.empty(0, dtype=[]))
    types = {column: rows.dtype[column] for column in rows.dtype.names or ()}
    if len(rows) == 0 or any(column not in types or types[column].str[1:] != f"{kind}4" for column in needed):
        raise ReadError(
            f"{path}: element {name!r} of a compressed .ply must have rows of {' '.join(needed)}, "
            f"each {'uint' if kind == 'u' else 'float'}."
        )
    return rows


def _lerp(packed: NDArray[np.uint32], chunk: NDArray[np.void], kind: str, of_chunk: NDArray[np.int64]) -> Floats:
    """11-10-11 bits to (N, 3) floats between the chunk's minimum and maximum."""
    result = np.empty((len(packed), 3), dtype=np.float32)
    for column, (axis, shift, most) in enumerate((("x", 21, 2047), ("y", 11, 1023), ("z", 0, 2047))):
        share = ((packed >> shift) & most).astype(np.float32) / np.float32(most)
        low, high = (chunk[f"{end}_{kind}{axis}"].astype(np.float32)[of_chunk] for end in ("min", "max"))
        result[:, column] = low * (1 - share) + high * share
    return result
