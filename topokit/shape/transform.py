"""A description of a shape by the topology of what lies below planes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import ArrayLike

from topokit.core.mesh import euler_transform as triangles
from topokit.core.mesh.euler_transform import EulerTransform
from topokit.errors import InputError
from topokit.shape.surface import surface_with_rims

if TYPE_CHECKING:
    from topokit.shape.shape import Shape


def euler_transform(
    shape: Shape,
    directions: int | ArrayLike = 32,
    heights: int | ArrayLike = 64,
    *,
    sharpness: float | None = None,
) -> EulerTransform:
    """χ of the part of the surface below every height, along every direction: a description of the shape.

    The surface is a mesh as given, or `surface()`. Heights are measured from the origin: center and scale shapes that
    are to be compared.

    Args:
        directions: (D, 3), of any length but 0, or how many evenly spread ones.
        heights: (H,) in the units of the shape, or how many from −r to r, r being the largest distance of a vertex from
            the origin.
        sharpness: None counts, which has no gradient. A number in 1 / length replaces each step by the sigmoid of
            `sharpness` times the height above it: differentiable in the vertices of a mesh, and in directions and
            heights given as tensors; it tends to the count as sharpness grows.

    Returns:
        `EulerTransform`: `directions`, `heights` and `euler`, (D, H).

    Raises:
        InputError: if arguments have other shapes, a direction is 0, or the shape has no surface.

    References:
        See `topokit.core.mesh.euler_transform`.

    Example:
        >>> import topokit as tk
        >>> from topokit.testing import torus_mesh
        >>> standing = tk.from_mesh(torus_mesh()).euler_transform([[1, 0, 0]], [-2, -0.8, 0, 0.8, 2])
        >>> standing.euler.tolist()
        [[0, 1, 0, -1, 0]]
    """
    mesh = shape.mesh
    if mesh is None:
        surface = surface_with_rims(shape)
        mesh = torch.from_numpy(surface.vertices), torch.from_numpy(surface.faces)
    vertices, faces = mesh
    if isinstance(directions, int):
        directions = triangles.even_directions(directions)
    if isinstance(heights, int):
        farthest = float(vertices.detach()[faces.unique()].norm(dim=1).max())
        heights = np.linspace(-farthest, farthest, heights)
    along = torch.as_tensor(directions).to(vertices)
    levels = torch.as_tensor(heights).to(vertices)
    if along.ndim != 2 or along.shape[1] != 3 or not len(along) or not bool((along.norm(dim=1) > 0).all()):
        raise InputError(f"directions have the shape {tuple(along.shape)}; expected (D, 3), none of them 0.")
    if levels.ndim != 1 or not len(levels):
        raise InputError(f"heights have the shape {tuple(levels.shape)}; expected a row of numbers.")
    if sharpness is not None and not sharpness > 0:
        raise InputError(f"sharpness is {sharpness!r}; expected a positive number, or None.")
    return triangles.euler_transform(vertices, faces, torch.nn.functional.normalize(along, dim=1), levels, sharpness)
