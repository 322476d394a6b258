"""Voronoi cells of the origin by comparing all pairs of neighbors: the same operations whatever the values are.

`voronoi` walks around each cell, which takes fewer operations, but needs to know after every step which cells are
closed. Both find the same vertices.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.core.linalg import squared_norm


@dataclass(frozen=True, eq=False)
class _Sides:
    """Which neighbors v cut the bisector of each neighbor u first, at its upper and at its lower end; (m, k) each.

    Attributes:
        upper: column of v counterclockwise of u.
        lower: column of v clockwise of u.
        has_upper: whether there is such a v.
        has_lower: likewise.
        is_edge: whether something of the bisector is left, so that u is a Voronoi neighbor of the origin.
    """

    upper: Tensor
    lower: Tensor
    has_upper: Tensor
    has_lower: Tensor
    is_edge: Tensor


def dense_cell_areas(tangent: Tensor) -> tuple[Tensor, Tensor]:
    """Exact Voronoi cell of the origin; arguments and results are those of `voronoi.exact_cell_areas`.

    Args:
        tangent: (..., k, 2). Memory is k² numbers for each cell.
    """
    cells = tangent.reshape(-1, *tangent.shape[-2:])
    squared = squared_norm(cells)
    sides = _adjacent(cells.detach(), squared.detach())
    upper, knows_upper = _cut(cells, squared, sides.upper, sides.has_upper)
    lower, knows_lower = _cut(cells, squared, sides.lower, sides.has_lower)
    length = (upper - lower).clamp(min=0).where(sides.is_edge, 0)
    is_open = (sides.is_edge & ~(knows_upper & knows_lower)).any(-1) | ~sides.is_edge.any(-1)
    shape = tangent.shape[:-2]
    return ((squared * length).sum(-1) / 4).reshape(shape), is_open.reshape(shape)


def _cut(cells: Tensor, squared: Tensor, other: Tensor, exists: Tensor) -> tuple[Tensor, Tensor]:
    """Where the bisector of v = other[u] cuts that of u; 0, and False, where it is not determined by the neighborhood.

    Args:
        cells: (m, k, 2).
        squared: (m, k), their squared lengths.
        other: (m, k), columns.
        exists: (m, k) bool.

    Returns:
        (m, k) parameter t along the bisector of u, and (m, k) bool.
    """
    (ux, uy), (vx, vy) = cells.unbind(-1), (part.gather(1, other) for part in cells.unbind(-1))
    twice_cross = 2 * (ux * vy - uy * vx)
    fixed = squared.detach()
    exists = exists & is_cut(twice_cross, fixed + fixed.gather(1, other))
    at = (squared.gather(1, other) - (ux * vx + uy * vy)) / twice_cross.where(exists, 1)
    is_known = exists & (fixed * (0.25 + at.detach().square()) <= fixed.amax(-1, keepdim=True))
    return at.where(is_known, 0), is_known


def is_cut(twice_cross: Tensor, squared: Tensor) -> Tensor:
    """Whether the bisectors of u and v meet so near that the derivatives of the place are finite.

    Args:
        twice_cross: 2 u × v, of any shape.
        squared: |u|² + |v|².
    """
    divisor = twice_cross.detach()
    return (squared.detach() / divisor / divisor).isfinite()


@torch.no_grad()
def _adjacent(cells: Tensor, squared: Tensor) -> _Sides:
    """The two cuts nearest to the foot of each bisector from either side, among those of all other neighbors."""
    x, y = cells.unbind(-1)
    cross = x[:, :, None] * y[:, None] - y[:, :, None] * x[:, None]
    product = x[:, :, None] * x[:, None] + y[:, :, None] * y[:, None]
    is_present = squared > 0
    at = (squared[:, None] - product) / (2 * cross)
    upper = at.where((cross > 0) & is_present[:, None], torch.inf).min(-1)
    lower = at.where((cross < 0) & is_present[:, None], -torch.inf).max(-1)
    column = torch.arange(cells.shape[1], device=cells.device)
    is_nearer = (squared[:, None] < squared[..., None]) | (
        (squared[:, None] == squared[..., None]) & (column < column[:, None])
    )
    is_hidden = ((cross == 0) & (product > 0) & is_nearer).any(-1)  # behind another one in the same direction
    is_edge = is_present & ~is_hidden & (upper.values > lower.values)
    return _Sides(upper.indices, lower.indices, upper.values.isfinite(), lower.values.isfinite(), is_edge)
