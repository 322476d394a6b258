"""Rows of a cloud with NaN, infinite or huge coordinates, or without a direction: which are dropped, and what is said.

Clouds in memory and clouds that are read in blocks keep to the same limits.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from topokit.core.arrays import Booleans, Floats
from topokit.core.samples import largest_coordinate
from topokit.errors import InputError

_FEW = 0.01
"""Share of invalid normals up to which their points are dropped; above it all normals are ignored."""


def valid_rows(points: Tensor, normals: Tensor | None, notes: list[str]) -> tuple[Tensor, Tensor | None]:
    """Rows with finite points and, where normals are kept, valid normals; what is dropped is noted."""
    finite, what_else = _usable(points.detach())
    n_dropped = int((~finite).sum())
    if n_dropped:
        notes.append(dropped_points(n_dropped, len(points), what_else))
        points = points[finite]
        normals = None if normals is None else normals[finite]
    if normals is None:
        return points, None
    valid = torch.isfinite(normals.detach()).all(-1) & (normals.detach() != 0).any(-1)
    n_invalid = int((~valid).sum())
    if n_invalid == 0:
        return points, normals
    note, are_ignored = invalid_normals(n_invalid, len(points))
    notes.append(note)
    return (points, None) if are_ignored else (points[valid], normals[valid])


def valid_in_block(points: Floats, normals: Floats | None) -> tuple[Booleans, Booleans]:
    """Which rows (N,) of a block have points whose squares are finite, and which of these have valid normals, too."""
    is_valid = np.ones(len(points), dtype=bool)
    for column in points.T:
        is_valid &= np.abs(column) <= largest_coordinate(torch.float64)  # false for NaN
    if normals is None:
        return is_valid, is_valid
    return is_valid, is_valid & np.isfinite(normals).all(1) & (normals != 0).any(1)


def dropped_points(n_dropped: int, n_points: int, what: str) -> str:
    """The sentence about points that are dropped.

    Raises:
        InputError: if they are more than half.
    """
    dropped = f"{n_dropped} of {n_points} points are {what}"
    if 2 * n_dropped > n_points:
        raise InputError(
            f"{dropped}. More than half of the cloud is invalid: keep the finite rows yourself to use them."
        )
    return f"{dropped} and were dropped."


def invalid_normals(n_invalid: int, n_points: int) -> tuple[str, bool]:
    """The sentence about normals without a direction, and whether they are so many that all normals are ignored."""
    what = f"{n_invalid} of {n_points} normals are zero or not finite"
    if n_invalid > _FEW * n_points:
        return f"{what}; all normals were ignored.", True
    return f"{what}; their points were dropped.", False


def _usable(points: Tensor) -> tuple[Tensor, str]:
    """Which rows are finite, and so near that squares are finite, too; and what the others are."""
    finite = points.isfinite().all(-1)
    if not points.is_floating_point():
        return finite, "NaN or infinite"
    near = (points.abs() <= largest_coordinate(points.dtype)).all(-1)
    n_far = int((finite & ~near).sum())
    if n_far == 0 or 2 * n_far > len(points):  # a whole cloud in such units is refused as one
        return finite, "NaN or infinite"
    return near, f"NaN, infinite or so far off that their squares leave {points.dtype}"
