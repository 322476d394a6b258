"""What every splat reader returns, and the decoding steps that several formats share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

CONVERTER = "PlayCanvas splat-transform (npx @playcanvas/splat-transform in out.ply) converts between splat formats."


class SplatTable(NamedTuple):
    """Splats as a file holds them, activated but neither normalized nor cleaned.

    Attributes:
        means: (N, 3) positions.
        scales: (N, 3) standard deviations along the rotation's axes, linear.
        quaternions: (N, 4), wxyz, any length.
        opacities: (N,), 0 … 1.
    """

    means: Floats
    scales: Floats
    quaternions: Floats
    opacities: Floats


def empty_table(n_splats: int) -> SplatTable:
    """Uninitialized arrays for `n_splats` rows."""
    return SplatTable(
        np.empty((n_splats, 3), dtype=np.float32),
        np.empty((n_splats, 3), dtype=np.float32),
        np.empty((n_splats, 4), dtype=np.float32),
        np.empty(n_splats, dtype=np.float32),
    )


def sigmoid(logits: Floats) -> Floats:
    """1 / (1 + e^−x)."""
    result: Floats = np.reciprocal(1 + np.exp(-logits))
    return result


def with_largest(index: NDArray[np.integer], others: Floats) -> Floats:
    """Unit quaternions whose largest component was left out ("smallest three").

    Args:
        index: (N,) 0 … 3, position of the component left out; it is positive.
        others: (N, 3), the remaining components in their order.

    Returns:
        (N, 4).
    """
    missing = np.sqrt(np.maximum(0, 1 - np.square(others).sum(axis=1)))
    quaternions = np.empty((len(others), 4), dtype=np.float32)
    for largest in range(4):
        rows = np.flatnonzero(index == largest)
        kept = [component for component in range(4) if component != largest]
        quaternions[rows[:, None], kept] = others[rows]
        quaternions[rows, largest] = missing[rows]
    return quaternions
