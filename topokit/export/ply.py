"""Curvature as colors and scalar fields of a PLY file."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from topokit.export.colors import Quantity, colored_surface
from topokit.inputs.ply import write_ply

if TYPE_CHECKING:
    from topokit.shape import Shape


def save_ply(shape: Shape, path: str | os.PathLike[str], color_by: Quantity = "gaussian") -> int:
    """Write positions, normals, colors and the fields gaussian, mean, total, k_min, k_max, area as binary PLY.

    A mesh keeps its vertices and faces; any other shape is written as its samples.

    Args:
        shape: any shape that is not batched.
        path: file to write, called .ply.
        color_by: "gaussian", "mean" or "total": the curvature shown as colors, see `topokit.export.colors`.

    Returns:
        Number of points written.

    Raises:
        InputError: if `color_by` is not one of the three, the samples are batched, the file is not called .ply, or its
            folder does not exist.
    """
    surface = colored_surface(shape, color_by)
    columns = dict(zip(("nx", "ny", "nz"), surface.normals.T, strict=True)) | surface.fields
    types = [(axis, "f8") for axis in "xyz"] + [(name, _type_of(values)) for name, values in columns.items()]
    types += [(name, "u1") for name in ("red", "green", "blue")]
    table = np.empty(len(surface.positions), dtype=types)
    for (name, _), values in zip(types, (*surface.positions.T, *columns.values(), *surface.colors.T), strict=True):
        table[name] = values
    elements = {"vertex": table}
    if surface.faces is not None:
        elements["face"] = np.empty(len(surface.faces), dtype=[("vertex_indices", "i4", (3,))])
        elements["face"]["vertex_indices"] = surface.faces
    write_ply(path, **elements)
    return len(table)


def _type_of(values: NDArray[np.float64]) -> str:
    """Single precision, unless values are too large for it: those of tiny shapes have huge curvature."""
    return "f8" if (np.abs(values) > np.finfo(np.float32).max).any() else "f4"
