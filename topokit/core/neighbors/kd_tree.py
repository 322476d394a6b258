"""Nearest points in SciPy's KD-tree, searched by several threads that an interrupt cannot harm."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.processors import n_cores
from topokit.errors import InputError

_BLOCK = 1 << 13
"""Queries of one task: about 20 ms of work, after which a thread can stop, and far more than a task costs."""
_SAMPLE = 1000  # points among which coinciding ones are looked for


def nearest_in_tree(tree: cKDTree, positions: NDArray[np.float64], n_nearest: int) -> NDArray[np.int64]:
    """Indices of the nearest points of a tree, as its own `query` gives them with `workers=-1`.

    SciPy's threads go on when an interrupt stops the caller, and write into arrays that are freed by then: the process
    crashes. Here each thread owns what it writes, and all of them have stopped when the interrupt is passed on.

    Args:
        tree: of the points.
        positions: (N, 3).
        n_nearest: k.

    Returns:
        (N,) for k = 1, else (N, k); the number of points in the tree where a distance is infinite.
    """

    def search(start: int) -> NDArray[np.int64]:
        return tree.query(positions[start : start + _BLOCK], n_nearest)[1]

    starts = range(0, len(positions), _BLOCK)
    n_threads = min(n_cores(), len(starts))
    if n_threads < 2:
        return np.concatenate([search(start) for start in starts or (0,)])
    threads = ThreadPoolExecutor(n_threads)
    try:
        return np.concatenate(list(threads.map(search, starts)))
    finally:
        threads.shutdown(cancel_futures=True)


def kd_tree_neighbors(points: Tensor, n_neighbors: int) -> Tensor:
    """Indices of the k nearest other points of every point, nearest first.

    Args:
        points: (N, 3) on the CPU, any float dtype.
        n_neighbors: k, less than N.

    Returns:
        (N, k) int64.

    Raises:
        InputError: if a squared distance overflows.
    """
    coordinates = points.double().numpy()
    rows = without_many_copies(coordinates, n_neighbors + 1)
    tree = cKDTree(coordinates[rows], balanced_tree=False, compact_nodes=False)
    is_whole = len(rows) == len(coordinates)
    order = tree.indices if is_whole else np.arange(len(coordinates))  # in tree order 100 000 queries are twice as fast
    in_order = nearest_in_tree(tree, coordinates[order], n_neighbors + 1)
    if in_order.max() == len(rows):  # what SciPy returns for a neighbor at infinite distance
        raise InputError("the coordinates are too large for distances between points: scale them down.")
    found = np.empty((len(order), n_neighbors + 1), dtype=np.int64)
    found[order] = in_order if is_whole else rows[in_order]
    own = np.arange(len(found))[:, None]
    if (found[:, :1] == own).all():
        return torch.from_numpy(found)[:, 1:]
    itself = found == own  # duplicates may come before the point itself
    itself[~itself.any(axis=1), -1] = True  # more duplicates than neighbors: drop the last
    return torch.from_numpy(found[~itself].reshape(len(found), n_neighbors))


def without_many_copies(coordinates: NDArray[np.float64], most: int) -> NDArray[np.int64]:
    """Indices of all points, or of at most `most` at each place where a sample shows that many coincide.

    Points in one place cannot be told apart by a tree, so that queries among them would take quadratic time.
    """
    count = len(coordinates)
    sample = coordinates[:: max(1, count // _SAMPLE)]
    if count <= _SAMPLE or 2 * len(np.unique(sample, axis=0)) > len(sample):
        return np.arange(count)
    place = np.unique(coordinates, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(place, kind="stable")
    is_first = np.append(True, place[order][1:] != place[order][:-1])
    start = np.maximum.accumulate(np.where(is_first, np.arange(count), 0))
    return np.sort(order[np.arange(count) - start < most])
