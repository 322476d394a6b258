"""Samples that are too close to each other to be independent: several scans of one surface, dense lines of scans."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

SPACED = 8
"""Neighbors that measure the local spacing: k of them lie within √(k/π) spacings."""

_NEAR = 0.5  # spacings, below which two samples are at one place


@torch.no_grad()
def close_pairs(
    points: Tensor, rows: Tensor, neighbors: Tensor, normals: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Some samples, (P,), and others within half a local spacing of these, (P,).

    Random samples of a surface have π / 4 others so close to them, on average. Two scans of one surface have more.

    Args:
        points: (N, 3), any float dtype and device.
        rows: (M,), of the samples that are asked about.
        neighbors: (M, k) indices of their nearest neighbors, nearest first; eight are used.
        normals: (N, 3); samples whose normals oppose each other are on two sides of a wall, however close.
    """
    neighbors = neighbors[:, :SPACED]
    distance = (points[neighbors] - points[rows, None]).norm(dim=-1)
    is_close = distance <= _NEAR * math.sqrt(math.pi / neighbors.shape[1]) * distance[:, -1:]
    if normals is not None:
        is_close &= (normals[neighbors] * normals[rows, None]).sum(-1) >= 0
    own, rank = is_close.nonzero(as_tuple=True)
    return rows[own], neighbors[own, rank]


@torch.no_grad()
def separate(points: Tensor, neighbors: Tensor, normals: Tensor | None = None) -> Tensor:
    """Indices (M,), ascending, of samples of which no two are close; all, if no more than eight would be left.

    Of two close ones, the one that is close to more others is left out; if they are close to as many, the one behind
    along z, y and x.

    Args:
        points: (N, 3), any float dtype and device.
        neighbors: (N, k) indices of the nearest neighbors, nearest first; eight are used.
        normals: (N, 3), or None; see `close_pairs`.
    """
    own, other = close_pairs(points, torch.arange(len(points), device=points.device), neighbors, normals)
    count = torch.bincount(torch.cat((own, other)), minlength=len(points))
    order = np.lexsort((*points.cpu().double().numpy().T, count.cpu().numpy()))
    rank = torch.empty_like(count)
    rank[torch.from_numpy(order).to(rank.device)] = torch.arange(len(rank), device=rank.device)
    is_kept = torch.ones_like(count, dtype=torch.bool)
    is_kept[torch.where(rank[own] > rank[other], own, other)] = False
    kept = is_kept.nonzero().squeeze(1)
    return kept if len(kept) > SPACED else torch.arange(len(points), device=points.device)
