"""3DGS and 2DGS .ply: one row of floats per splat, log scales, logit opacities, read by property name."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.splats.formats.ply_header import PlyElement, PlyHeader, read_ply_header
from topokit.adapters.splats.formats.table import Floats, SplatTable, empty_table, require_bytes, sigmoid
from topokit.errors import ReadError

_MEANS = ("x", "y", "z")
_SCALES = ("scale_0", "scale_1", "scale_2")
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")
_BLOCK = 1 << 19  # bytes read at once: the rows stay in the cache while their columns are taken out


def read_ply(path: Path) -> SplatTable:
    """Splats of a 3DGS .ply, or of a 2DGS .ply, whose third scale is zero.

    Normals (nx ny nz) and colours are not looked at. Extra columns, half floats, doubles, big-endian and text files
    are understood.

    Raises:
        ReadError: if a property is missing, or the file is shorter than its header says.

    Reference:
        Kerbl et al. 2023, DOI 10.1145/3592433; Huang et al. 2024, DOI 10.1145/3641519.3657428.
    """
    header = read_ply_header(path)
    vertex = _checked(header, path)
    table = empty_table(vertex.count)
    n_scales = 3 if "scale_2" in header.names("vertex") else 2
    table.scales[:, n_scales:] = 0
    start = 0
    for rows in _blocks(header, vertex, path):
        block = slice(start, start + len(rows))
        _copy(rows, _MEANS, table.means[block])
        _copy(rows, _SCALES[:n_scales], table.scales[block])
        _copy(rows, _ROTATION, table.quaternions[block])
        np.exp(table.scales[block, :n_scales], out=table.scales[block, :n_scales])
        table.opacities[block] = sigmoid(rows["opacity"].astype(np.float32))
        start += len(rows)
    return table


def _checked(header: PlyHeader, path: Path) -> PlyElement:
    vertex = header["vertex"]
    if vertex is None or vertex.has_lists:
        raise ReadError(f"{path} has no element 'vertex' with plain properties; it is no splat .ply.")
    missing = [name for name in (*_MEANS, *_SCALES[:2], *_ROTATION, "opacity") if name not in header.names("vertex")]
    if missing:
        raise ReadError(
            f"{path} lacks the vertex properties {', '.join(missing)}; a splat .ply has "
            "x y z, scale_0 … scale_2, rot_0 … rot_3 and opacity."
        )
    if vertex.count == 0:
        raise ReadError(f"{path} announces 0 splats.")
    width = 2 * len(vertex.row.names or ()) if header.is_ascii else vertex.row.itemsize  # text: a digit and a blank
    start = header.start if header.is_ascii else header.offset("vertex", path)
    require_bytes(path, f"{vertex.count} splats", vertex.count * width - header.is_ascii, path.stat().st_size - start)
    return vertex


def _copy(rows: NDArray[np.void], names: tuple[str, ...], target: Floats) -> None:
    """Columns by name into (n, len(names)) floats; doubles beyond float32 become infinite."""
    for column, name in enumerate(names):
        target[:, column] = rows[name]


def _blocks(header: PlyHeader, vertex: PlyElement, path: Path) -> Iterator[NDArray[np.void]]:
    if header.is_ascii:
        yield _text(header, vertex, path)
        return
    n_rows = max(1, _BLOCK // vertex.row.itemsize)
    buffer = np.empty(min(n_rows, vertex.count), dtype=vertex.row)
    with path.open("rb", buffering=0) as file:
        file.seek(header.offset("vertex", path))
        for start in range(0, vertex.count, n_rows):
            rows = buffer[: vertex.count - start]
            if file.readinto(rows.view(np.uint8).data) != rows.nbytes:
                raise ReadError(f"{path} ended while it was read: it is truncated or being written.")
            yield rows


def _text(header: PlyHeader, vertex: PlyElement, path: Path) -> NDArray[np.void]:
    if header.elements[0].name != "vertex":
        raise ReadError(f"{path}: in a text .ply, the element 'vertex' must come first.")
    with path.open("rb") as file:
        file.seek(header.start)
        table = np.loadtxt(file, dtype=np.float64, max_rows=vertex.count, ndmin=2, comments=None)
    names = vertex.row.names or ()
    if table.shape != (vertex.count, len(names)):
        raise ReadError(f"{path} holds {table.shape} numbers; {(vertex.count, len(names))} were announced.")
    rows = np.empty(len(table), dtype=[(name, np.float64) for name in names])
    for column, name in enumerate(names):
        rows[name] = table[:, column]
    return rows
