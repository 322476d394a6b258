"""Curvature at the vertices or samples of a shape, and diverging colors for it: what every export shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.core.arrays import Floats, Integers
from topokit.core.local.curvature import Curvature
from topokit.errors import InputError

if TYPE_CHECKING:
    from topokit.shape import Shape

Quantity = Literal["gaussian", "mean", "total"]
_LEAST = 1e-200  # stands for a distance of 0; its inverse can still be summed
_NEAREST = 6  # samples from which the value at a mesh vertex is interpolated


@dataclass(frozen=True, eq=False)
class ColoredSurface:
    """A surface with curvature as fields and colors.

    Attributes:
        positions: (N, 3), the vertices of a mesh, else the samples.
        normals: (N, 3), unit; outward where the shape is oriented.
        fields: gaussian, mean, total, k_min, k_max and area, (N,) each.
        colors: (N, 3) of 0 … 255.
        faces: (F, 3) of a mesh, facing outward where it is closed, else None.
    """

    positions: Floats
    normals: Floats
    fields: dict[str, Floats]
    colors: NDArray[np.uint8]
    faces: Integers | None


def curvature_of_one(shape: Shape, done: str) -> Curvature:
    """Curvature of a shape that is not batched, without a graph.

    Args:
        shape: any shape.
        done: what is done with it, for the message: "exported" or "drawn".

    Raises:
        InputError: if the samples are batched.
    """
    if shape.samples.points.ndim != 2:
        raise InputError(
            f"one shape is {done} at a time; the samples are batched, {tuple(shape.samples.points.shape)}. "
            "Make a shape of each item."
        )
    with torch.no_grad():
        return shape.curvature()


def colored_surface(shape: Shape, color_by: Quantity = "gaussian") -> ColoredSurface:
    """Curvature of a shape at its vertices if it has a mesh, else at its samples.

    Vertices without a face, such as those that were merged with an equal one, are left out.

    A vertex has the distance-weighted mean of its nearest samples. Blue is negative, white zero, red positive; the
    scale ends at the 95th percentile of the absolute value, so that single peaks do not wash out the rest.

    Raises:
        InputError: if `color_by` is not one of the three, or the samples are batched.
    """
    if color_by not in get_args(Quantity):
        raise InputError(f"color_by is {color_by!r}; expected 'gaussian', 'mean' or 'total'.")
    local = curvature_of_one(shape, "exported")
    positions = shape.samples.points.detach().cpu().double().numpy()
    parts = (local.normals, local.gaussian, local.mean, local.total, local.principal, local.area)
    table = torch.cat([part.reshape(len(positions), -1) for part in parts], dim=1).cpu().double().numpy()
    faces = None
    if shape.mesh is not None:
        used, corners = np.unique(shape.mesh[1].cpu().numpy(), return_inverse=True)
        vertices, faces = shape.mesh[0].detach().cpu().double().numpy()[used], corners.reshape(-1, 3)
        table = interpolate(positions, table, vertices)
        positions = vertices
    fields = dict(zip(("gaussian", "mean", "total", "k_min", "k_max", "area"), table.T[3:], strict=True))
    lengths = np.linalg.norm(table[:, :3], axis=1, keepdims=True)
    normals = table[:, :3] / np.maximum(lengths, np.finfo(float).tiny)
    return ColoredSurface(positions, normals, fields, diverging_colors(fields[color_by]), faces)


def diverging_colors(values: Floats, limit: float | None = None) -> NDArray[np.uint8]:
    """(N,) values as (N, 3) colors, blue through white to red, symmetric about zero.

    Args:
        values: (N,).
        limit: where the colors end; the 95th percentile of the absolute value by default.
    """
    scale = np.quantile(np.abs(values), 0.95) if limit is None else limit
    share = np.clip(values / scale, -1, 1) if scale > 0 else np.zeros_like(values)
    blue, white, red = np.array([33, 102, 172]), np.array([247, 247, 247]), np.array([178, 24, 43])
    ends = np.where(share[:, None] < 0, blue, red)
    return np.rint(white + np.abs(share)[:, None] * (ends - white)).astype(np.uint8)


def interpolate(points: Floats, values: Floats, targets: Floats, n_nearest: int = _NEAREST) -> Floats:
    """Values of points (N, ...) at targets (M, 3): distance-weighted means over the nearest points, (M, ...)."""
    distances, index = cKDTree(points).query(targets, min(n_nearest, len(points)))
    weights = 1 / np.maximum(distances, 1e-3 * distances[:, -1:] + _LEAST)
    totals = weights.sum(axis=1)
    return np.einsum("mk,mk...->m...", weights, values[index]) / totals.reshape(-1, *[1] * (values.ndim - 1))
