"""Betti numbers of solids on 3D grids.

Conventions are those of `grid.euler`. Labeling is SciPy's and runs on the CPU.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from torch import Tensor

from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, as_grid, dual_connectivity, solid_euler


def betti_numbers(field: Tensor | ArrayLike, level: float = 0.0, connectivity: int = DEFAULT_CONNECTIVITY) -> Tensor:
    """Betti numbers of the solid {field > level}: components, tunnels, cavities.

    Its surface has b0 + b2 components with total genus b1.

    Args:
        field: (..., X, Y, Z), any real dtype but uint64, any device. NaN counts as background.
        level: voxels strictly above it are inside.
        connectivity: 6 or 26, that of the solid; its cavities are regions of the background under the other one.

    Returns:
        (..., 3) int64 tensor of b0, b1 = b0 + b2 - χ and b2, on the field's device.

    Raises:
        InputError: if the field has fewer than three axes, or the connectivity is neither 6 nor 26.
    """
    field = as_grid(field, connectivity)
    euler = solid_euler(field, level, connectivity)
    counts = []
    for item in np.ndindex(*euler.shape):
        inside = (field[item] > level).cpu().numpy()
        n_regions = _n_components(~np.pad(inside, 1), dual_connectivity(connectivity))
        counts.append((_n_components(inside, connectivity), n_regions - 1))
    b0, b2 = euler.new_tensor(counts).reshape(*euler.shape, 2).unbind(-1)
    return torch.stack((b0, b0 + b2 - euler, b2), dim=-1)


def _n_components(mask: NDArray[np.bool_], connectivity: int) -> int:
    return int(ndimage.label(mask, structure=np.ones((3, 3, 3)) if connectivity == 26 else None)[1])
