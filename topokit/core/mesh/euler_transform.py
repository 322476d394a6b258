"""The Euler characteristic transform of triangles: χ of what lies below each height, along each direction.

A vertex, edge or triangle is below a height if all of its corners are. The smooth form replaces each step by a sigmoid.

References:
    Turner, Mukherjee and Boyer, "Persistent homology transform for modeling shapes and surfaces", Information and
    Inference 3, 2014, DOI 10.1093/imaiai/iau011. Röell and Rieck, "Differentiable Euler characteristic transforms for
    shape classification", ICLR 2024 (the smooth form).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from topokit.core.arrays import Floats


@dataclass(frozen=True, eq=False)
class EulerTransform:
    """χ of the part of a surface below heights, along directions.

    Attributes:
        directions: (D, 3) unit vectors.
        heights: (H,) of planes across each direction, measured from the origin.
        euler: (D, H) of what lies at or below the plane; int64, or floating if it is smooth.
    """

    directions: Tensor
    heights: Tensor
    euler: Tensor


def euler_transform(
    vertices: Tensor, faces: Tensor, directions: Tensor, heights: Tensor, sharpness: float | None = None
) -> EulerTransform:
    """The transform of triangles.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        directions: (D, 3), unit.
        heights: (H,).
        sharpness: of the sigmoids, in 1 / length: differentiable in vertices, directions and heights. None counts.
    """
    edges = torch.unique(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).sort(dim=1).values, dim=0)
    simplices = torch.unique(faces)[:, None], edges, faces
    rows = []
    for direction in directions:
        along = vertices @ direction
        enters = [along[corners].amax(1) for corners in simplices]
        counts = [_below(one, heights, sharpness) for one in enters]
        rows.append(counts[0] - counts[1] + counts[2])
    return EulerTransform(directions, heights, torch.stack(rows))


def _below(enters: Tensor, heights: Tensor, sharpness: float | None) -> Tensor:
    """(H,) how many of the values (n,) are at most each height."""
    if sharpness is None:
        return torch.searchsorted(enters.detach().sort().values, heights, right=True)
    return torch.sigmoid(sharpness * (heights - enters[:, None])).sum(0)


def even_directions(count: int) -> Floats:
    """(D, 3) unit vectors, about evenly spread on a spiral.

    Reference:
        González, "Measurement of areas on a sphere using Fibonacci and latitude–longitude lattices", Mathematical
        Geosciences 42, 2010, DOI 10.1007/s11004-009-9257-x.
    """
    place = np.arange(count) + 0.5
    height, turn = 1 - 2 * place / count, np.pi * (1 + 5**0.5) * place
    across = np.sqrt(1 - height**2)
    return np.column_stack((across * np.cos(turn), across * np.sin(turn), height))
