"""Exact k nearest neighbors in torch operations: points in the order of a balanced tree, on any device.

The points are sorted along the longest side of their box, halved, and so on: log₂(N / 16) batched sorts, after which
sixteen successive points are a leaf. Nothing in this depends on how the points are spread. The search takes the leaves
whose boxes are nearest to a leaf of queries, level by level, always the same number of them, and compares all pairs. A
query is finished if its k-th neighbor is nearer than any box that was left out. The others are searched again one by
one, in each round among four times as many leaves, until all are finished. How many leaves the first round compares,
and whether it expects ties, is tried on some leaves: surfaces need few, solids more, and on lattices all distances tie.

Memory is linear in the points. The host learns one number per round and per trial: how many queries are left.

Reference:
    J. L. Bentley, "Multidimensional binary search trees used for associative searching", CACM 18 (1975),
    doi:10.1145/361002.361007 (the tree). The search in rounds of equal work is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.core.neighbors.pairs import Selection, blocks, k_smallest, k_smallest_if_clear, squared_distances

_LEAF = 16  # points of a leaf, at most
_WIDTH = 16  # leaves compared with a leaf of queries in the first round: on surfaces most 20 neighbors are among them
_WIDER = 40  # the same for solids, where they finish 97 % of the queries
_FIRST_ROUNDS = tuple((width, select) for width in (_WIDTH, _WIDER) for select in (k_smallest_if_clear, k_smallest))
_PROBES = 64  # leaves of queries on which kinds of a first round are tried, the cheapest first
_GROWTH = 4  # times as many leaves in each further round
_ROUNDING = 1 - 1e-14  # distances to boxes are rounded, too


@dataclass(frozen=True, eq=False)
class KdOrder:
    """B lists of points in the order of a balanced tree.

    Attributes:
        points: (B · L, s, 3), those of each leaf; absent ones are infinite.
        index: (B · L, s) int64, their rows in their own list.
        boxes: for each level l the lowest and highest corners, (2, B · 2ˡ, 3); those of empty nodes are inverted.
        n_lists: B.
    """

    points: Tensor
    index: Tensor
    boxes: tuple[Tensor, ...]
    n_lists: int

    def nearest_leaves(self, low: Tensor, high: Tensor, lists: Tensor, width: int) -> tuple[Tensor, Tensor]:
        """Some leaves whose boxes are near to a box, and a squared distance below which there is no other.

        Args:
            low: (t, 3), lowest corner.
            high: (t, 3), highest corner.
            lists: (t,) the list that is searched.
            width: how many leaves, at most.

        Returns:
            (t, w) rows of `points`, and (t,): infinite where all leaves are taken.
        """
        depth = len(self.boxes) - 1
        level = min(depth, math.ceil(math.log2(width + 1)))
        nodes = torch.arange(1 << level, device=low.device).expand(len(low), -1)
        limit = torch.full_like(low[:, 0], torch.inf)
        while True:
            rows = nodes + (lists << level)[:, None]
            if nodes.shape[1] > width:
                near = _box_distances(low, high, self.boxes[level], rows).topk(width + 1, largest=False)
                limit = torch.minimum(limit, near.values[:, -1])
                nodes, rows = (part.gather(1, near.indices[:, :-1]) for part in (nodes, rows))
            if level == depth:
                return rows, limit
            nodes, level = torch.stack((2 * nodes, 2 * nodes + 1), dim=2).flatten(1), level + 1


def kd_order(points: Tensor) -> KdOrder:
    """Sort points into a balanced tree.

    Args:
        points: (B, N, 3); absent points are infinite.
    """
    n_lists, count, _ = points.shape
    depth = max(0, math.ceil(math.log2(count / _LEAF)))
    missing = (math.ceil(count / (1 << depth)) << depth) - count
    points = torch.nn.functional.pad(points, (0, 0, 0, missing), value=torch.inf).flatten(0, 1)
    index = torch.arange(count + missing, device=points.device).repeat(n_lists)
    boxes = []
    for level in range(depth + 1):
        segments = points.reshape(n_lists << level, -1, 3)
        low, high = segments.amin(1), segments.masked_fill(segments.isinf(), -torch.inf).amax(1)
        boxes.append(torch.stack((low, high)))
        if level < depth:
            axis = (high - low).argmax(1)[:, None, None].expand(-1, segments.shape[1], 1)
            order = segments.gather(2, axis).squeeze(2).argsort(dim=1, stable=True)
            order += torch.arange(len(segments), device=points.device)[:, None] * segments.shape[1]
            points, index = points.index_select(0, order.flatten()), index.index_select(0, order.flatten())
    return KdOrder(points.reshape(n_lists << depth, -1, 3), index.reshape(n_lists << depth, -1), tuple(boxes), n_lists)


def kd_order_neighbors(points: Tensor, k: int) -> Tensor:
    """Indices of the k nearest other points of every point, (B, N, 3) → (B, N, k), ties in the order of the indices.

    Args:
        points: double precision; absent points are infinite, and their neighbors arbitrary.
        k: less than the number of present points, and no less than that of all points in one place minus one.
    """
    tree = kd_order(points)
    found = torch.zeros(tree.index.numel(), k, dtype=torch.int64, device=points.device)
    rows = torch.arange(len(found), device=points.device).reshape(tree.index.shape)
    width, select = _first_round(tree, rows, found)
    rows, width = _search(tree, rows, width, found, select), _WIDTH
    while len(rows) > 0:
        rows, width = _search(tree, rows[:, None], width, found, k_smallest), _GROWTH * width
    return found.reshape(len(points), -1, k)[:, : points.shape[1]]


def _first_round(tree: KdOrder, rows: Tensor, found: Tensor) -> tuple[int, Selection]:
    """The cheapest kind of a first round that finishes most queries of some leaves; arguments as for `_search`."""
    some = rows[:: max(1, len(rows) // _PROBES)]
    for width, select in _FIRST_ROUNDS[:-1]:
        if 2 * len(_search(tree, some, width, found, select)) < some.numel():
            return width, select
    return _FIRST_ROUNDS[-1]


def _search(tree: KdOrder, rows: Tensor, width: int, found: Tensor, select: Selection) -> Tensor:
    """One round for groups of queries.

    Args:
        tree: what is searched.
        rows: (t, q), those of the queries among the points of the tree; each group is of one list.
        width: leaves that each group is compared with.
        found: (B · N, k), where the results go; those of queries that are not finished are not the last word.
        select: the k smallest distances.

    Returns:
        (n,) rows of the queries that are not finished.
    """
    points, index, n_padded = tree.points.flatten(0, 1), tree.index.flatten(), len(found) // tree.n_lists
    left = torch.zeros_like(rows, dtype=torch.bool)
    for group in blocks(len(rows), 2 * width, rows.device):
        queries, lists = points[rows[group]], rows[group, 0] // n_padded
        is_present = queries[..., 0].isfinite()
        high = queries.masked_fill(~is_present[..., None], -torch.inf).amax(1)
        leaves, limit = tree.nearest_leaves(queries.amin(1), high, lists, width)
        for part in blocks(len(leaves), leaves.shape[1] * rows.shape[1] * tree.index.shape[1], rows.device):
            distances = squared_distances(queries[part], tree.points[leaves[part]].flatten(1, 2))
            candidates = tree.index[leaves[part]].flatten(1)[:, None]
            smallest, nearest, is_clear = select(distances, candidates, found.shape[1] + 1)
            is_near = (smallest[..., -1] < _ROUNDING * limit[part, None]) | limit[part, None].isinf()
            left[group][part] = is_present[part] & ~(is_near & is_clear)
            own = index[rows[group][part]]
            found[own + (lists[part] * n_padded)[:, None]] = _without_itself(nearest, own)
    return rows[left]


def _without_itself(nearest: Tensor, own: Tensor) -> Tensor:
    """Neighbors (..., k + 1) without the query itself, which is among them if the round has finished it: (..., k)."""
    position = (nearest == own[..., None]).long().argmax(-1, keepdim=True)
    column = torch.arange(nearest.shape[-1] - 1, device=own.device)
    return nearest.gather(-1, column + (column >= position))


def _box_distances(low: Tensor, high: Tensor, boxes: Tensor, rows: Tensor) -> Tensor:
    """Squared distances (t, w) between boxes (t, 3) and those in the given rows (t, w)."""
    lows, highs = boxes[0][rows], boxes[1][rows]
    gap = torch.maximum(lows - high[:, None], low[:, None] - highs).clamp_(min=0).square_()
    return gap[..., 0] + gap[..., 1] + gap[..., 2]
