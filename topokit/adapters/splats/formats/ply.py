"""3DGS and 2DGS .ply: one row of floats per splat, log scales, logit opacities, read by property name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.splats.formats.splat_table import Floats, SplatTable, empty_table, sigmoid
from topokit.errors import ReadError
from topokit.inputs.ply import ply_elements

_MEANS = ("x", "y", "z")
_SCALES = ("scale_0", "scale_1", "scale_2")
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")
_BLOCK = 1 << 13  # rows taken at once: they stay in the cache while their columns are copied


def read_ply(path: Path) -> SplatTable:
    """Splats of a 3DGS .ply, or of a 2DGS .ply, whose third scale is zero.

    Normals (nx ny nz) and colors are ignored. Extra columns, half floats, doubles, big-endian and text files are
    accepted.

    Raises:
        ReadError: if a property is missing, or the file is shorter than its header announces.

    Reference:
        Kerbl et al. 2023, DOI 10.1145/3592433; Huang et al. 2024, DOI 10.1145/3641519.3657428.
    """
    vertex = _checked(ply_elements(path).get("vertex"), path)
    table = empty_table(len(vertex))
    n_scales = 3 if "scale_2" in (vertex.dtype.names or ()) else 2
    table.scales[:, n_scales:] = 0
    for start in range(0, len(vertex), _BLOCK):
        block = slice(start, start + _BLOCK)
        rows = vertex[block]
        _copy(rows, _MEANS, table.means[block])
        _copy(rows, _SCALES[:n_scales], table.scales[block])
        _copy(rows, _ROTATION, table.quaternions[block])
        np.exp(table.scales[block, :n_scales], out=table.scales[block, :n_scales])
        table.opacities[block] = sigmoid(rows["opacity"].astype(np.float32))
    return table


def _checked(vertex: NDArray[np.void] | None, path: Path) -> NDArray[np.void]:
    if vertex is None:
        raise ReadError(f"{path} has no element 'vertex'; it is not a splat .ply.")
    plain = [name for name in vertex.dtype.names or () if vertex.dtype[name].kind != "O"]  # "O": a list
    missing = [name for name in (*_MEANS, *_SCALES[:2], *_ROTATION, "opacity") if name not in plain]
    if missing:
        raise ReadError(
            f"{path} lacks the vertex properties {', '.join(missing)}; a splat .ply has "
            "x y z, scale_0 … scale_2, rot_0 … rot_3 and opacity."
        )
    if len(vertex) == 0:
        raise ReadError(f"{path} announces 0 splats.")
    return vertex


def _copy(rows: NDArray[np.void], names: tuple[str, ...], target: Floats) -> None:
    """Columns by name into (n, len(names)) floats; doubles beyond float32 become infinite."""
    for column, name in enumerate(names):
        target[:, column] = rows[name]
