"""Nearest points in a KD-tree, searched by several threads that an interrupt cannot harm."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.core.processors import n_cores

_BLOCK = 1 << 13
"""Queries of one task: about 20 ms of work, after which a thread can stop, and far more than a task costs."""


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
