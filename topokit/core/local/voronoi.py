"""Tangent Voronoi cells: the area element of every point (paper, Section II-A)."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from topokit.core.linalg import squared_norm
from topokit.errors import InputError

AreaMethod = Literal["exact", "monte-carlo"]


def cell_areas(tangent: Tensor, method: AreaMethod = "exact", resolution: int = 32) -> tuple[Tensor, Tensor]:
    """Area of the origin's Voronoi cell among its projected neighbours, and whether the cell is open.

    Args:
        tangent: (..., k, 2), neighbours in the tangent plane of the centre, which is the origin.
        method: "exact" or "monte-carlo".
        resolution: W, points per side of the Monte Carlo grid; "exact" does not use it.

    Returns:
        areas (...,) in squared units of length, and is_open (...,) bool: True where some side of the point has no
        neighbour, as on the boundary of a surface.

    Raises:
        InputError: for an unknown method.
    """
    if method == "exact":
        return exact_cell_areas(tangent)
    if method == "monte-carlo":
        return monte_carlo_cell_areas(tangent, resolution), exact_cell_areas(tangent.detach())[1]
    raise InputError(f"area method {method!r} is not known; use 'exact' or 'monte-carlo'.")


def exact_cell_areas(tangent: Tensor) -> tuple[Tensor, Tensor]:
    """Voronoi cells by clipping every bisector against all others; differentiable almost everywhere.

    The bisector of neighbour u is u/2 + t u⊥; neighbour v cuts it at t = (|v|² − u·v) / (2 u×v). What is left between
    the largest lower and the smallest upper cut is the cell's edge, and the cell is a fan of triangles of area
    |u|² Δt / 4 around the origin. Which neighbours cut an edge is found outside the graph on k × k pairs; the cuts
    themselves are then recomputed inside it on k pairs.

    A vertex farther away than the farthest neighbour is beyond what the neighbourhood knows: the empty circle through
    it says that the surface ends there. Such an edge is cut at the foot of its perpendicular, which leaves the part of
    the cell that lies within the surface's own wedge.

    Args:
        tangent: (..., k, 2).

    Returns:
        areas (...,) and is_open (...,) as in `cell_areas`. Neighbours that coincide with the origin are ignored; a
        neighbourhood that spans no area has area 0 and is open.
    """
    squared = squared_norm(tangent)  # (..., k)
    is_present = squared.detach() > 0
    far = 4 * tangent.detach().abs().amax((-2, -1), keepdim=True)
    lower_cut, upper_cut, is_edge = _cutting_neighbors(tangent.detach().where(is_present[..., None], far))
    is_edge = is_edge & is_present
    lower, lower_known = _cut(tangent, squared, lower_cut)
    upper, upper_known = _cut(tangent, squared, upper_cut)
    length = torch.where(is_edge, (upper - lower).clamp(min=0), 0)
    areas = (squared * length).sum(-1) / 4
    open_edge = is_edge & ~(lower_known & upper_known)
    return areas, open_edge.any(-1) | ~is_edge.any(-1)


def _cutting_neighbors(tangent: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """For every bisector the neighbours that cut it from below and above, (..., k) each, and whether an edge is left.

    An index equal to the bisector's own means: nothing cuts that side.
    """
    own = torch.arange(tangent.shape[-2], device=tangent.device)
    first, second = tangent[..., 0], tangent[..., 1]
    outer = first[..., :, None] * second[..., None, :]
    cross = (outer - outer.mT).add_(0.0)  # (..., k, k): u × v, row u, column v; the sum makes −0 into +0
    rise = first[..., :, None] * first[..., None, :] + second[..., :, None] * second[..., None, :]
    rise = torch.sub((first * first + second * second)[..., None, :], rise, out=rise)  # |v|² − u·v
    # Where u × v = 0 the quotient is +∞ (no cut), or −∞ where v is nearer in the same direction (u is hidden).
    # Of exact duplicates, 0/0, the first is kept.
    tiny = tangent.new_tensor(torch.finfo(tangent.dtype).tiny)
    rise += torch.where(own[None, :] < own[:, None], -tiny, tiny)
    is_upper = cross >= 0
    at = torch.div(rise, cross, out=rise)
    upper, upper_cut = at.where(is_upper, torch.inf).min(-1)
    lower, lower_cut = at.where(~is_upper, -torch.inf).max(-1)
    return torch.where(lower.isinf(), own, lower_cut), torch.where(upper.isinf(), own, upper_cut), lower < upper


def _cut(tangent: Tensor, squared: Tensor, cutter: Tensor) -> tuple[Tensor, Tensor]:
    """Where `cutter` (..., k) cuts each bisector, and whether that vertex is within the neighbourhood's reach."""
    other = tangent.take_along_dim(cutter[..., None], dim=-2)
    twice_cross = 2 * (tangent[..., 0] * other[..., 1] - tangent[..., 1] * other[..., 0])
    crosses = twice_cross != 0
    rise = squared_norm(other) - (other[..., 0] * tangent[..., 0] + other[..., 1] * tangent[..., 1])
    at = rise / torch.where(crosses, twice_cross, 1)
    reach = squared.detach().amax(-1, keepdim=True)
    known = crosses & (squared.detach() * (0.25 + at.detach().square()) <= reach)
    return torch.where(known, at, 0), known


def monte_carlo_cell_areas(tangent: Tensor, resolution: int = 32) -> Tensor:
    """The paper's Monte Carlo area: share of a W × W grid that is nearer to the origin than to any neighbour.

    The grid covers the axis-aligned square around the origin that holds all neighbours, enlarged by 1.1. Cells that
    the neighbourhood does not close are cut by that square only.

    Args:
        tangent: (..., k, 2).
        resolution: W.

    Returns:
        (...,). Counting has no derivative: the gradient is that of the square's area alone, at a fixed count.
        Relative sampling error about 1/(share · W²)^½.

    Reference:
        Paper, equation `area element`.
    """
    half = 1.1 * tangent.abs().amax((-2, -1))  # (...,)
    ticks = (torch.arange(resolution, dtype=tangent.dtype, device=tangent.device) + 0.5) / resolution * 2 - 1
    grid = torch.stack(torch.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)  # (W², 2), in units of half
    with torch.no_grad():
        scale = half.where(half > 0, 1)[..., None, None]
        scaled = tangent / scale
        limits = scaled.square().sum(-1) / 2  # (..., k)
        count = torch.zeros_like(half)
        for part in grid.split(128):
            nearest = (part @ scaled.mT <= limits[..., None, :]).all(-1)  # (..., 128)
            count = count + nearest.sum(-1)
    return count / len(grid) * (2 * half).square()
