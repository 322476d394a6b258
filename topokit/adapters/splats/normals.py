"""From the scales and rotations of splats to their axes and normals."""

from __future__ import annotations

import torch
from torch import Tensor


def rotation_matrices(quaternions: Tensor) -> Tensor:
    """Rotation matrices of unit quaternions wxyz: (..., 4) → (..., 3, 3); column i is the axis of scale i."""
    w, x, y, z = quaternions.unbind(-1)
    entries = (
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    )
    matrices: Tensor = torch.stack(entries, dim=-1).reshape(*quaternions.shape[:-1], 3, 3)
    return matrices


def normals_of(scales: Tensor, quaternions: Tensor) -> Tensor:
    """Unit normals (N, 3) of splats, whose signs are unknown: the axes of their smallest scales.

    Args:
        scales: (N, 3), linear.
        quaternions: (N, 4), wxyz, of length 1.
    """
    return rotation_matrices(quaternions).take_along_dim(scales.argmin(-1)[:, None, None], dim=2).squeeze(2)


def axes_by_scale(scales: Tensor, quaternions: Tensor) -> tuple[Tensor, Tensor]:
    """Scales (N, 3), the largest first, and unit axes as rows (N, 3, 3) in the same order: the last is the normal.

    Arguments are those of `normals_of`.
    """
    ordered, order = scales.sort(dim=-1, descending=True)
    return ordered, rotation_matrices(quaternions).mT.take_along_dim(order[..., None], dim=-2)


def right_handed(axes: Tensor) -> Tensor:
    """Rows (N, 3, 3) with the last one turned over where they are left-handed."""
    handedness = torch.linalg.det(axes.detach()).sign()
    return torch.cat((axes[:, :2], axes[:, 2:] * handedness[:, None, None]), dim=1)
