"""Per-point work in blocks of rows, so that memory is bounded with and without gradients."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor
from torch.utils.checkpoint import checkpoint

CHUNK = 1 << 12  # rows per block for 20 neighbors, so that temporaries stay in the cache; fewer rows for more neighbors
_LARGE_CHUNK = 1 << 15  # the same on accelerators, which few rows leave idle


def in_chunks(
    work: Callable[[Tensor], tuple[Tensor, ...]],
    n_points: int,
    device: torch.device,
    n_neighbors: int,
    chunk: int | None = None,
) -> tuple[Tensor, ...]:
    """Concatenate `work(rows)` over consecutive blocks of row indices.

    If the first block needs gradients, the temporaries of all others are recomputed in the backward pass. What stays in
    memory between forward and backward is the results, not N × k temporaries.

    Args:
        work: maps (m,) int64 row indices to a tuple of tensors whose first dimension is m.
        n_points: number of rows in all.
        device: where the row indices live.
        n_neighbors: k; blocks of more than 20 neighbors have fewer rows.
        chunk: rows per block for 20 neighbors; by default what suits the device.
    """
    chunk = chunk or (CHUNK if device.type == "cpu" else _LARGE_CHUNK)
    first, *rest = torch.arange(n_points, device=device).split(max(1, min(chunk, 20 * chunk // n_neighbors)))
    parts = [work(first)]
    needs_gradient = any(part.requires_grad for part in parts[0])
    for rows in rest:
        parts.append(
            checkpoint(work, rows, use_reentrant=False, preserve_rng_state=False) if needs_gradient else work(rows)
        )
    return tuple(torch.cat(column) for column in zip(*parts, strict=True))
