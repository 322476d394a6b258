"""Distances of all pairs, and the k smallest of them with ties in the order of the indices."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import reduce

import torch
from torch import Tensor

Selection = Callable[[Tensor, Tensor, int], tuple[Tensor, Tensor, Tensor]]

_CACHED_PAIRS = 1 << 17  # pairs compared at once on the CPU, so that they stay in the cache
_MANY_PAIRS = 1 << 25  # pairs compared at once on accelerators, to keep them busy within some hundred megabytes


def k_smallest(distances: Tensor, index: Tensor, k: int) -> tuple[Tensor, Tensor, Tensor]:
    """The k smallest distances of each row and their indices, nearest first, equal ones in the order of the indices.

    Args:
        distances: (..., m), m ≥ k.
        index: (..., m) int64, or broadcastable; different within each row.
        k: how many.

    Returns:
        (..., k) distances, (..., k) indices, and (...) bool, always True. Nothing depends on the order of the columns.
    """
    index = index.expand(distances.shape)
    last = distances.topk(k, largest=False).values[..., -1:]
    rank = torch.where(distances == last, index, torch.iinfo(index.dtype).max).masked_fill_(distances < last, -1)
    chosen = rank.topk(k, largest=False).indices
    distances, index = distances.gather(-1, chosen), index.gather(-1, chosen)
    by_index = index.argsort(-1)
    distances, index = distances.gather(-1, by_index), index.gather(-1, by_index)
    distances, by_distance = distances.sort(dim=-1, stable=True)
    return distances, index.gather(-1, by_distance), torch.ones_like(last[..., 0], dtype=torch.bool)


def k_smallest_if_clear(distances: Tensor, index: Tensor, k: int) -> tuple[Tensor, Tensor, Tensor]:
    """What `k_smallest` returns, in half the time, where no two of the k + 1 smallest distances are equal.

    Returns:
        (..., k) distances, (..., k) indices, and (...) bool: whether they are what `k_smallest` returns.
    """
    smallest, columns = distances.topk(min(k + 1, distances.shape[-1]), largest=False)
    is_clear = (smallest[..., 1:] > smallest[..., :-1]).all(-1)
    return smallest[..., :k], index.expand(distances.shape).gather(-1, columns[..., :k]), is_clear


def squared_distances(queries: Tensor, points: Tensor) -> Tensor:
    """|q − p|² of all pairs, (..., n, 3) and (..., m, 3) → (..., n, m); by differences, which keep all digits."""
    differences = (queries[..., :, None, axis] - points[..., None, :, axis] for axis in range(3))
    return reduce(Tensor.add_, (difference.mul_(difference) for difference in differences))


def blocks(count: int, pairs_each: int, device: torch.device) -> Iterator[slice]:
    """Slices of rows, each with as many pairs as are compared at once on the device."""
    step = max(1, (_CACHED_PAIRS if device.type == "cpu" else _MANY_PAIRS) // pairs_each)
    return (slice(start, start + step) for start in range(0, count, step))
