"""Where a sampled surface ends: points whose tangent Voronoi cell is open on one side."""

from __future__ import annotations

from torch import Tensor

_LEAST_LOOP = 12  # flagged points on the smallest hole that stands out of the noise
_LEAST_SHARE = 0.005  # open cells that sharp edges and thin sheets produce on closed surfaces


def boundary_points(is_open: Tensor, neighbors: Tensor, support: int = 3) -> Tensor:
    """Open cells that are not alone: boundaries are curves, so a boundary point has boundary points beside it.

    Args:
        is_open: (N,) bool, as `cell_areas` gives it.
        neighbors: (N, k).
        support: least number of neighbours that must be open too.

    Returns:
        (N,) bool. Not differentiable.
    """
    return is_open & (is_open[neighbors].sum(-1) >= support)


def looks_closed(is_boundary: Tensor) -> bool:
    """Whether the boundary points (N,) are too few to mean a hole: under 12, or under half a per cent."""
    return int(is_boundary.sum()) < max(_LEAST_LOOP, _LEAST_SHARE * is_boundary.numel())
