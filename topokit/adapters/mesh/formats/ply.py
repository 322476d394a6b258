"""PLY meshes: polygons beside any other lists, and triangle strips."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.mesh.polygons import fans
from topokit.core.arrays import Floats, Integers
from topokit.errors import ReadError
from topokit.inputs.files import head
from topokit.inputs.ply import ply_elements

_CORNERS = ("vertex_indices", "vertex_index")  # names of the list of corners
_RESTART = -1  # in a strip: the next one begins


def is_plain(path: Path) -> bool:
    """Whether trimesh reads the file quickly and rightly: text with one list, the corners, in each face."""
    header = head(path).partition(b"end_header")[0]
    faces = re.search(rb"^element\s+face\b.*?(?=^element|\Z)", header, re.MULTILINE | re.DOTALL)
    is_text = re.search(rb"^format\s+ascii", header, re.MULTILINE) is not None
    return is_text and b"tristrips" not in header and faces is not None and faces.group().count(b"property list") == 1


def read_ply(path: Path) -> tuple[Floats, Integers]:
    """Vertices (V, 3) and triangles (F, 3), polygons cut into fans.

    Raises:
        ReadError: if there are no vertices, or neither faces nor strips, or an index is out of range.
    """
    elements = ply_elements(path, list_lengths={"face": dict.fromkeys(_CORNERS, 3)})
    vertex, face, strips = (elements.get(name) for name in ("vertex", "face", "tristrips"))
    if vertex is None or not {"x", "y", "z"} <= set(vertex.dtype.names or ()):
        raise ReadError(f"{path} has no element 'vertex' with x, y and z.")
    vertices = np.stack([np.asarray(vertex[axis], dtype=np.float64) for axis in "xyz"], axis=1)
    parts = [_faces(_lists(face, path))] if face is not None and len(face) else []
    parts += [_strip(strip) for strip in _lists(strips, path)] if strips is not None else []
    faces = np.concatenate([np.empty((0, 3), dtype=np.int64), *parts])
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise ReadError(f"{path}: its faces name vertices {faces.min()} to {faces.max()}, and it has {len(vertices)}.")
    return vertices, faces


def _lists(table: NDArray[np.void], path: Path) -> Any:
    """The corners of every row: (F, 3), or an array of arrays."""
    names = table.dtype.names or ()
    found = next((name for name in _CORNERS if name in names), None)
    if found is None:
        raise ReadError(f"{path}: its faces have {', '.join(names) or 'no properties'}; vertex_indices was expected.")
    return table[found]


def _faces(rows: Any) -> Integers:
    if rows.ndim == 2:
        return np.asarray(rows, dtype=np.int64)
    counts = np.array([len(row) for row in rows])
    used = counts > 2  # a face of two corners has no area
    corners = [row for row, is_used in zip(rows, used, strict=True) if is_used]
    return fans(np.concatenate([np.empty(0, dtype=np.int64), *corners]).astype(np.int64), counts[used])


def _strip(strip: Any) -> Integers:
    """The triangles of a strip: every three corners in a row, every other one turned; −1 begins a new strip."""
    corners = np.asarray(strip, dtype=np.int64)
    triangles = np.stack((corners[:-2], corners[1:-1], corners[2:]), axis=1) if len(corners) > 2 else corners[:0, None]
    start = np.maximum.accumulate(np.where(corners == _RESTART, np.arange(len(corners)) + 1, 0))[: len(triangles)]
    is_odd = (np.arange(len(triangles)) - start) % 2 == 1
    triangles = triangles.reshape(-1, 3)
    triangles[is_odd] = triangles[is_odd][:, [1, 0, 2]]
    a, b, c = triangles.T
    return triangles[(triangles != _RESTART).all(axis=1) & (a != b) & (b != c) & (c != a)]
