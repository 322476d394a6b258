"""k nearest neighbors of batches of points in torch operations: all pairs for few points, a sorted tree for many."""

from __future__ import annotations

import torch
from torch import Tensor

from topokit.core.neighbors.kd_order import kd_order_neighbors
from topokit.core.neighbors.pairs import blocks, k_smallest, squared_distances

# All pairs take no look at the device, the tree one per round; but at this number the tree has 16 times less to do.
MOST_FOR_ALL_PAIRS = 4096


def device_neighbors(
    points: Tensor, n_neighbors: int, lengths: Tensor | None, most: int = MOST_FOR_ALL_PAIRS
) -> Tensor:
    """Indices of the k nearest other points of every point, ties in the order of the indices.

    Distances are compared in double precision, whatever the points are.

    Args:
        points: (B, N, 3), any float dtype and device.
        n_neighbors: k, less than the number of points of each item.
        lengths: (B,) number of points of each item, the others are padding; None if there is no padding.
        most: points of an item up to which all pairs are compared.

    Returns:
        (B, N, k) int64. Rows of padding, and of points that are NaN, hold their own index.
    """
    rows = torch.arange(points.shape[1], device=points.device)
    is_absent = points.detach().isnan().any(-1, keepdim=True)
    if lengths is not None:
        is_absent = is_absent | (rows >= lengths[:, None])[..., None]
    present = _unit_scale(points.detach().double().masked_fill(is_absent, 0)).masked_fill(is_absent, torch.inf)
    search = _all_pairs if len(rows) <= most else _tree
    return torch.where(is_absent, rows[:, None], search(present, n_neighbors))


def _unit_scale(points: Tensor) -> Tensor:
    """The points times the power of two that brings them to [−1, 1]: exact, and no square leaves the range."""
    exponent = torch.frexp(points.abs().amax((1, 2), keepdim=True)).exponent
    half = exponent // 2  # in two steps, as 2¹⁰²⁴ is infinite
    return torch.ldexp(torch.ldexp(points, -half), half - exponent)


def _all_pairs(points: Tensor, k: int) -> Tensor:
    n_points = points.shape[1]
    index = torch.arange(n_points, device=points.device)
    found = []
    for rows in blocks(n_points, len(points) * n_points, points.device):
        distances = squared_distances(points[:, rows], points)
        distances.diagonal(rows.start, 1, 2).fill_(torch.inf)
        found.append(k_smallest(distances, index, k)[1])
    return torch.cat(found, dim=1)


def _tree(points: Tensor, k: int) -> Tensor:
    """No tree can tell points in one place apart: it gets at most k + 1 of them, which are the neighbors of the others.

    (Queries among more would find them all at the distance of every box, so that none is left out.)
    """
    order, start, rank = _places(points)
    is_surplus = torch.empty_like(rank, dtype=torch.bool).scatter_(1, order, rank > k)
    found = kd_order_neighbors(points.masked_fill(is_surplus[..., None], torch.inf), k)
    first = (start[..., None] + torch.arange(k, device=points.device)).clamp_(max=points.shape[1] - 1)
    copies = order.gather(1, first.flatten(1)).reshape(found.shape)
    copies = torch.empty_like(found).scatter_(1, order[..., None].expand(found.shape), copies)
    return torch.where(is_surplus[..., None], copies, found)


def _places(points: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Points (B, N, 3) sorted by place, then by index.

    Returns:
        (B, N) each: row of the point, where its place starts in this order, and how many of the place come before.
    """
    position = torch.arange(points.shape[1], device=points.device).expand(points.shape[:2])
    order = position
    for axis in range(3):
        order = order.gather(1, points[..., axis].gather(1, order).argsort(dim=1, stable=True))
    in_order = points.gather(1, order[..., None].expand(points.shape))
    is_new = torch.ones_like(order, dtype=torch.bool)
    is_new[:, 1:] = (in_order[:, 1:] != in_order[:, :-1]).any(-1)
    start = torch.where(is_new, position, 0).cummax(1).values
    return order, start, position - start
