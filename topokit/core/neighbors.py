"""k nearest neighbors as indices, and the connected components of their graph.

Distances are not returned: differentiable callers compute them from the points again.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.labels import connected_labels
from topokit.core.samples import enough_neighbors
from topokit.errors import InputError

_CUDA_PAIRS = 1 << 26  # distances held at once by the exact search on accelerators


def nearest_neighbors(points: Tensor, n_neighbors: int) -> Tensor:
    """Indices of the k nearest other points of every point.

    Args:
        points: (..., N, 3), any float dtype and device. Batch items never see each other.
        n_neighbors: k; the point itself is not counted, its exact duplicates are.

    Returns:
        (..., N, k) int64 on the points' device, nearest first. Not differentiable (integers).

    Raises:
        InputError: if there are not more points than neighbors.
    """
    n_points = points.shape[-2]
    enough_neighbors(n_neighbors)
    if n_points <= n_neighbors:
        raise InputError(
            f"{n_points} points are too few for {n_neighbors} neighbors each: "
            f"give at least {n_neighbors + 1} points, or pass a smaller n_neighbors (at least 3)."
        )
    search = _kd_tree if points.device.type == "cpu" else _exact
    if points.ndim == 2:
        return search(points.detach(), n_neighbors)
    items = points.detach().reshape(-1, n_points, 3)
    return torch.stack([search(item, n_neighbors) for item in items]).reshape(*points.shape[:-1], n_neighbors)


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


def _kd_tree(points: Tensor, n_neighbors: int) -> Tensor:
    coordinates = points.double().numpy()
    tree = cKDTree(coordinates, balanced_tree=False, compact_nodes=False)
    order = tree.indices  # neighboring queries share their way down the tree: twice as fast for 100 000 points
    _, in_order = tree.query(coordinates[order], n_neighbors + 1, workers=-1)
    found = np.empty((len(order), n_neighbors + 1), dtype=np.int64)
    found[order] = in_order
    if found.max() == len(found):  # what SciPy returns for a neighbor at infinite distance
        raise InputError("the coordinates are too large for distances between points: scale them down.")
    own = np.arange(len(found))[:, None]
    if (found[:, :1] == own).all():
        return torch.from_numpy(found)[:, 1:]
    itself = found == own  # duplicates may come before the point itself
    itself[~itself.any(axis=1), -1] = True  # more duplicates than neighbors: drop the last
    return torch.from_numpy(found[~itself].reshape(len(found), n_neighbors))


def _exact(points: Tensor, n_neighbors: int) -> Tensor:
    n_points = len(points)
    rows = max(1, _CUDA_PAIRS // n_points)
    found = []
    for start in range(0, n_points, rows):
        part = points[start : start + rows]
        squared = torch.zeros(len(part), n_points, dtype=points.dtype, device=points.device)
        for axis in range(3):  # explicit differences: the expanded square loses half the digits
            squared += (part[:, axis, None] - points[None, :, axis]).square()
        own = torch.arange(len(part), device=points.device)
        squared[own, start + own] = torch.inf
        found.append(squared.topk(n_neighbors, largest=False).indices)
    return torch.cat(found)
