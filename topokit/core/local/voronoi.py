"""Tangent Voronoi cells: the area element of every point (paper, Section II-A)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from topokit.core.linalg import squared_norm
from topokit.core.local.dense_cells import dense_cell_areas, is_cut
from topokit.core.residence import stays_on_device
from topokit.errors import InputError

AreaMethod = Literal["exact", "monte-carlo"]


def cell_areas(tangent: Tensor, method: AreaMethod = "exact", resolution: int = 32) -> tuple[Tensor, Tensor]:
    """Area of the origin's Voronoi cell among its projected neighbors, and whether the cell is open.

    Args:
        tangent: (..., k, 2), neighbors in the tangent plane of the center, which is the origin.
        method: "exact" or "monte-carlo".
        resolution: W, points per side of the Monte Carlo grid; "exact" does not use it.

    Returns:
        areas (...,) in squared units of length, and is_open (...,) bool: True where some side of the point has no
        neighbor, as on the boundary of a surface.

    Raises:
        InputError: for an unknown method.
    """
    if method == "exact":
        return exact_cell_areas(tangent)
    if method == "monte-carlo":
        return monte_carlo_cell_areas(tangent, resolution), exact_cell_areas(tangent.detach())[1]
    raise InputError(f"area method {method!r} is unknown; use 'exact' or 'monte-carlo'.")


@dataclass(frozen=True, eq=False)
class CellVertices:
    """Pairs of adjacent Voronoi neighbors of the origin, one pair for every vertex of m cells. Not differentiable.

    Attributes:
        first: (V,) rows of the flattened (m·k, 2) neighbors.
        second: (V,) likewise, counterclockwise of `first`.
        cell: (V,) the cells that the vertices belong to, 0 … m−1.
        is_unbounded: (m,) bool, cells that are not closed by their neighbors.
    """

    first: Tensor
    second: Tensor
    cell: Tensor
    is_unbounded: Tensor


def exact_cell_areas(tangent: Tensor, vertices: CellVertices | None = None) -> tuple[Tensor, Tensor]:
    """Exact Voronoi cell of the origin, differentiable almost everywhere.

    The cell's edge on the bisector of neighbor u lies at u/2 + t u⊥ between the cuts t of the two adjacent Voronoi
    neighbors, and the cell is a fan of triangles of area |u|² Δt / 4 around the origin. Which neighbors are adjacent is
    found outside the graph; the cuts are computed inside it.

    A vertex farther away than the farthest neighbor is not determined by the neighborhood: the empty circle through
    it means that the surface ends there. Such an edge is cut at the foot of its perpendicular, which leaves the part of
    the cell that lies within the surface's own wedge.

    Args:
        tangent: (..., k, 2).
        vertices: what `cell_vertices` returns for these neighbors, if it is known.

    Returns:
        areas (...,) and is_open (...,) as in `cell_areas`. Neighbors that coincide with the origin are ignored; a
        neighborhood that spans no area has area 0 and is open.
    """
    if vertices is None and stays_on_device(tangent):
        return dense_cell_areas(tangent)
    cells = tangent.reshape(-1, *tangent.shape[-2:])  # (m, k, 2)
    squared = squared_norm(cells)
    vertices = vertices or cell_vertices(cells)
    upper, lower = _cuts(cells.flatten(0, 1), squared.flatten(), vertices)
    fixed = squared.detach()
    distance = fixed.flatten().index_select(0, vertices.first) * (0.25 + upper.detach().square())
    is_known = distance <= fixed.amax(-1).index_select(0, vertices.cell)
    is_open = vertices.is_unbounded.clone()
    is_open[vertices.cell[~is_known]] = True
    none = torch.zeros_like(fixed).flatten()
    upper = none.scatter(0, vertices.first, upper.where(is_known, 0))
    lower = none.scatter(0, vertices.second, lower.where(is_known, 0))
    length = (upper - lower).clamp(min=0).reshape(squared.shape)
    shape = tangent.shape[:-2]
    return ((squared * length).sum(-1) / 4).reshape(shape), is_open.reshape(shape)


def _cuts(tangent: Tensor, squared: Tensor, vertices: CellVertices) -> tuple[Tensor, Tensor]:
    """Where the bisectors of two adjacent neighbors u and v meet, as a parameter t along each.

    Neighbor v cuts the bisector of u at t = (|v|² − u·v) / (2 u×v), and u cuts that of v at (u·v − |u|²) / (2 u×v).

    Args:
        tangent: (n, 2) neighbors.
        squared: (n,) their squared lengths.
        vertices: pairs of u and v.

    Returns:
        (V,) upper end of u's edge and (V,) lower end of v's; infinite where u and v are so nearly parallel that the
        derivatives would overflow.
    """
    first, second = vertices.first, vertices.second
    (ux, uy), (vx, vy) = (tangent.index_select(0, index).unbind(-1) for index in (first, second))
    twice_cross = 2 * (ux * vy - uy * vx)
    crosses = is_cut(twice_cross, squared.index_select(0, first) + squared.index_select(0, second))
    twice_cross = twice_cross.where(crosses, 1)
    product = ux * vx + uy * vy
    upper = (squared.index_select(0, second) - product) / twice_cross
    lower = (product - squared.index_select(0, first)) / twice_cross
    return upper.where(crosses, torch.inf), lower.where(crosses, -torch.inf)


@torch.no_grad()
def cell_vertices(cells: Tensor) -> CellVertices:
    """Vertices of the Voronoi cells of the origin among neighbors (m, k, 2)."""
    is_present = squared_norm(cells) > 0  # a neighbor at the origin has no bisector: it is moved far away
    far = 4 * cells.abs().amax((-2, -1), keepdim=True)
    cells = cells.where(is_present[..., None], far)
    rows = torch.arange(len(cells), device=cells.device)
    first, second, unbounded = _walk(cells, rows)
    if len(unbounded) > 0:  # walk the other way from the nearest neighbor, on the mirror image
        mirrored = cells[unbounded] * cells.new_tensor((1, -1))
        before, after, _ = _walk(mirrored, unbounded)
        first, second = torch.cat((first, after)), torch.cat((second, before))
    cell = first.div(cells.shape[1], rounding_mode="floor")
    is_real = is_present.flatten()[torch.stack((first, second))].all(0)
    is_unbounded = torch.zeros_like(rows, dtype=torch.bool)
    is_unbounded[torch.cat((unbounded, cell[~is_real]))] = True
    return CellVertices(first[is_real], second[is_real], cell[is_real], is_unbounded)


def _walk(cells: Tensor, rows: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Visit the Voronoi neighbors of the origin counterclockwise, from the nearest, which always is one.

    The next neighbor after u is the v on its left that cuts its bisector first. All cells take their steps together;
    those that are finished drop out.

    Args:
        cells: (m, k, 2), no neighbor at the origin.
        rows: (m,) the number of each cell.

    Returns:
        Successive neighbors, (V,) and (V,), as row · k + index, and the rows where no next neighbor was found.
    """
    x, y = (part.contiguous() for part in cells.unbind(-1))
    squared = x * x + y * y
    start = squared.argmin(-1, keepdim=True)
    row, start_x, start_y = rows[:, None], x.gather(1, start), y.gather(1, start)
    here, here_x, here_y = start, start_x, start_y
    steps = []
    for _ in range(cells.shape[1]):
        cross = (here_x * y - here_y * x).clamp_(min=0)  # 0 on the right, and exactly 0 for parallel neighbors
        at = squared.addcmul(here_x, x, value=-1).addcmul_(here_y, y, value=-1)
        at = at.div_(cross).nan_to_num_(torch.inf, torch.inf, torch.inf)  # 0 below: no cut
        nearest, there = at.min(-1, keepdim=True)
        there_x, there_y = x.gather(1, there), y.gather(1, there)
        closes = (here_x * start_y > here_y * start_x) & (start_x * there_y >= start_y * there_x)
        there = torch.where(closes, start, there)
        ends = nearest.isinf()
        steps.append((row, here, there, ends))
        walking = (ends | closes).logical_not().squeeze(1).nonzero().squeeze(1)
        if len(walking) == 0:
            break
        here, here_x, here_y = there, there_x, there_y
        if len(walking) < len(row):
            row, here, here_x, here_y, start, start_x, start_y, x, y, squared = (
                part.index_select(0, walking)
                for part in (row, here, here_x, here_y, start, start_x, start_y, x, y, squared)
            )
    row, here, there, ends = (torch.cat(column).squeeze(1) for column in zip(*steps, strict=True))
    first_row, found = row * cells.shape[1], ends.logical_not()
    return (first_row + here)[found], (first_row + there)[found], row[ends]


def monte_carlo_cell_areas(tangent: Tensor, resolution: int = 32) -> Tensor:
    """The paper's Monte Carlo area: share of a W × W grid that is nearer to the origin than to any neighbor.

    The grid covers the axis-aligned square around the origin that holds all neighbors, enlarged by 1.1. Cells that
    the neighborhood does not close are cut by that square only.

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
