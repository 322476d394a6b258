"""Curvature to look at: colours and scalar fields in a PLY file."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.errors import InputError

if TYPE_CHECKING:
    from topokit.shape import Shape

Floats = NDArray[np.float64]
_NEAREST = 6  # samples that a mesh vertex takes its value from


def write_curvature_ply(
    path: str | os.PathLike[str], shape: Shape, color_by: Literal["gaussian", "mean", "total"] = "gaussian"
) -> int:
    """Write positions, normals, colours and the fields gaussian, mean, total, k_min, k_max, area as binary PLY.

    A mesh keeps its vertices and faces; each vertex takes the distance-weighted mean of its nearest samples. Anything
    else is written as its samples. Blue is negative, white zero, red positive; the scale ends at the 95th percentile
    of the absolute value, so that single peaks do not wash out the rest.

    Returns:
        Number of points written.

    Raises:
        InputError: if `color_by` is not one of the three, or the folder to write to does not exist.
    """
    from plyfile import PlyData, PlyElement

    if color_by not in ("gaussian", "mean", "total"):
        raise InputError(f"color_by is {color_by!r}; expected 'gaussian', 'mean' or 'total'.")
    target = os.fspath(path)
    if not os.path.isdir(os.path.dirname(target) or "."):
        raise InputError(f"the folder of {target} does not exist; make it first.")
    positions, columns = _fields(shape)
    colors = diverging_colors(columns[color_by])
    names = [*columns, "red", "green", "blue"]
    types = [(name, "f4") for name in columns] + [(name, "u1") for name in names[-3:]]
    table = np.empty(len(positions), dtype=[(axis, "f8") for axis in "xyz"] + types)
    for index, axis in enumerate("xyz"):
        table[axis] = positions[:, index]
        table[names[len(columns) + index]] = colors[:, index]
    for name, values in columns.items():
        table[name] = values
    elements = [PlyElement.describe(table, "vertex")]
    if shape.mesh is not None:
        faces = np.empty(len(shape.mesh[1]), dtype=[("vertex_indices", "i4", (3,))])
        faces["vertex_indices"] = shape.mesh[1].cpu().numpy()
        elements.append(PlyElement.describe(faces, "face"))
    PlyData(elements, byte_order="<").write(target)
    return len(positions)


def diverging_colors(values: Floats) -> NDArray[np.uint8]:
    """(N,) values as (N, 3) colours, blue through white to red, symmetric about zero."""
    scale = np.quantile(np.abs(values), 0.95)
    share = np.clip(values / scale, -1, 1) if scale > 0 else np.zeros_like(values)
    blue, white, red = np.array([33, 102, 172]), np.array([247, 247, 247]), np.array([178, 24, 43])
    ends = np.where(share[:, None] < 0, blue, red)
    return np.rint(white + np.abs(share)[:, None] * (ends - white)).astype(np.uint8)


def _fields(shape: Shape) -> tuple[Floats, dict[str, Floats]]:
    with torch.no_grad():
        local = shape.curvature()
    positions = shape.samples.points.detach().cpu().double().numpy()
    parts = (local.normals, local.gaussian, local.mean, local.total, local.principal, local.area)
    table = torch.cat([part.reshape(len(positions), -1) for part in parts], dim=1).cpu().double().numpy()
    if shape.mesh is not None:
        vertices = shape.mesh[0].detach().cpu().double().numpy()
        table = _interpolate(positions, table, vertices)
        positions = vertices
    names = ("nx", "ny", "nz", "gaussian", "mean", "total", "k_min", "k_max", "area")
    return positions, dict(zip(names, table.T, strict=True))


def _interpolate(points: Floats, values: Floats, targets: Floats) -> Floats:
    distances, index = cKDTree(points).query(targets, _NEAREST)
    weights = 1 / np.maximum(distances, 1e-3 * distances[:, -1:] + np.finfo(float).tiny)
    return (values[index] * weights[..., None]).sum(axis=1) / weights.sum(axis=1, keepdims=True)
