"""Curvature to look at: colours and scalar fields in a PLY file."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from topokit.errors import InputError
from topokit.export.colors import Quantity, draw

if TYPE_CHECKING:
    from topokit.shape import Shape


def write_curvature_ply(path: str | os.PathLike[str], shape: Shape, color_by: Quantity = "gaussian") -> int:
    """Write positions, normals, colours and the fields gaussian, mean, total, k_min, k_max, area as binary PLY.

    A mesh keeps its vertices and faces; anything else is written as its samples. See `topokit.export.colors.draw`.

    Returns:
        Number of points written.

    Raises:
        InputError: if `color_by` is not one of the three, the file is not called .ply, the folder to write to does not
            exist, or the samples are batched.
    """
    from plyfile import PlyData, PlyElement

    target = os.fspath(path)
    if not target.lower().endswith(".ply"):
        raise InputError(f"{target} does not end with .ply, and PLY is what is written; name it so.")
    if not os.path.isdir(os.path.dirname(target) or "."):
        raise InputError(f"the folder of {target} does not exist; make it first.")
    drawing = draw(shape, color_by)
    columns = dict(zip(("nx", "ny", "nz"), drawing.normals.T, strict=True)) | drawing.fields
    types = [(axis, "f8") for axis in "xyz"] + [(name, "f4") for name in columns]
    types += [(name, "u1") for name in ("red", "green", "blue")]
    table = np.empty(len(drawing.positions), dtype=types)
    for (name, _), values in zip(types, (*drawing.positions.T, *columns.values(), *drawing.colors.T), strict=True):
        table[name] = values
    elements = [PlyElement.describe(table, "vertex")]
    if drawing.faces is not None:
        faces = np.empty(len(drawing.faces), dtype=[("vertex_indices", "i4", (3,))])
        faces["vertex_indices"] = drawing.faces
        elements.append(PlyElement.describe(faces, "face"))
    PlyData(elements, byte_order="<").write(target)
    return len(table)
