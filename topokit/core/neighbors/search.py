"""k nearest neighbors as indices, and the connected components of their graph.

Distances are not returned: differentiable callers compute them from the points again.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import torch
from torch import Tensor

from topokit.core.labels import connected_labels
from topokit.core.neighbors.device import device_neighbors
from topokit.core.neighbors.kd_tree import kd_tree_neighbors
from topokit.core.residence import stays_on_device
from topokit.core.samples import enough_neighbors, enough_points
from topokit.errors import InputError

SearchMethod = Literal["auto", "kd-tree", "device"]


def nearest_neighbors(
    points: Tensor, n_neighbors: int, *, lengths: Tensor | None = None, method: SearchMethod = "auto"
) -> Tensor:
    """Indices of the k nearest other points of every point; exact whatever the method.

    Args:
        points: (..., N, 3), any float dtype and device. Batch items never see each other.
        n_neighbors: k; the point itself is not counted, its exact duplicates are.
        lengths: (...) number of points of each batch item, where the others are padding; None if there is none.
        method: "kd-tree" is SciPy's on the CPU; "device" works in torch operations where the points are, with ties in
            the order of the indices. "auto" takes the KD-tree on the CPU, which is faster there, else "device".

    Returns:
        (..., N, k) int64 on the points' device, nearest first; rows of padding hold their own index. Not differentiable
        (integers).

    Raises:
        InputError: if there are not more points than neighbors, or for an unknown method.
    """
    n_points = points.shape[-2]
    enough_neighbors(n_neighbors)
    enough_points(n_points, n_neighbors, "the cloud")
    if method not in get_args(SearchMethod):
        raise InputError(f"search method {method!r} is unknown; use 'auto', 'kd-tree' or 'device'.")
    items = points.detach().reshape(-1, n_points, 3)
    if len(items) == 0:
        raise InputError(f"the batch of shape {tuple(points.shape)} holds no cloud: give at least one.")
    sizes = None if lengths is None else lengths.reshape(-1)
    may_stay = stays_on_device(points) and points.device.type != "mps"  # that lacks the float64 of the search
    if method == "device" or (method == "auto" and may_stay):
        found = device_neighbors(items, n_neighbors, sizes)
    else:
        counts = [n_points] * len(items) if sizes is None else sizes.tolist()
        trees = [kd_tree_neighbors(item[:count].cpu(), n_neighbors) for item, count in zip(items, counts, strict=True)]
        found = torch.stack([_with_padding(tree, n_points) for tree in trees]).to(points.device)
    return found.reshape(*points.shape[:-1], n_neighbors)


def first_neighbors(known: Tensor, n_neighbors: int) -> Tensor | None:
    """The nearest n_neighbors of the known indices (..., N, k), nearest first; None if more than k are wanted."""
    return known[..., :n_neighbors] if n_neighbors <= known.shape[-1] else None


def merged_neighbors(neighbors: Tensor) -> Tensor:
    """Neighbor indices of batch items as rows of their merged point list.

    Args:
        neighbors: (..., N, k), indices within each batch item.

    Returns:
        (B·N, k), each item's indices offset by its first row.
    """
    n_points, n_neighbors = neighbors.shape[-2:]
    items = neighbors.reshape(-1, n_points, n_neighbors)
    starts = torch.arange(len(items), device=neighbors.device) * n_points
    return (items + starts[:, None, None]).reshape(-1, n_neighbors)


def neighbor_components(neighbors: Tensor) -> Tensor:
    """Connected components of the neighbor graph, edges taken in both directions.

    Args:
        neighbors: (N, k) indices of one point list.

    Returns:
        (N,) int64 labels 0 … c−1 on the same device, numbered by first appearance. Not differentiable.
    """
    n_points, n_neighbors = neighbors.shape
    columns = neighbors.cpu().numpy().ravel()
    rows = np.repeat(np.arange(n_points), n_neighbors)
    return torch.from_numpy(connected_labels(n_points, rows, columns)).to(neighbors.device)


def _with_padding(neighbors: Tensor, n_points: int) -> Tensor:
    """Neighbors (n, k) followed by rows of padding that hold their own index, (N, k)."""
    if len(neighbors) == n_points:
        return neighbors
    own = torch.arange(len(neighbors), n_points)[:, None].expand(-1, neighbors.shape[1])
    return torch.cat((neighbors, own))
