"""What every splat reader gives back, and the checks that come before memory is taken."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from topokit.errors import ReadError

Floats = NDArray[np.float32]

CONVERTER = "PlayCanvas splat-transform (npx @playcanvas/splat-transform in out.ply) converts between splat formats."
_FREE = 1 << 28  # bytes that any compressed file may unfold to
_MOST_EXPANSION = 200  # real scenes unfold two- to twenty-fold


class SplatTable(NamedTuple):
    """Splats as a file holds them, activated but neither normalised nor cleaned.

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
    """Uninitialised arrays for `n_splats` rows."""
    return SplatTable(
        np.empty((n_splats, 3), dtype=np.float32),
        np.empty((n_splats, 3), dtype=np.float32),
        np.empty((n_splats, 4), dtype=np.float32),
        np.empty(n_splats, dtype=np.float32),
    )


def require_bytes(path: Path | str, what: str, needed: int, available: int) -> None:
    """Refuse a header that promises more than the file holds.

    Raises:
        ReadError: if `needed` exceeds `available`.
    """
    if needed > available:
        raise ReadError(
            f"{path} announces {what}, which takes {needed} bytes, but has {available} bytes for it: "
            "it is truncated or its header is wrong. Export or download it again."
        )


def require_expansion(path: Path | str, needed: int, file_size: int) -> None:
    """Refuse a small compressed file that would unfold to an absurd amount of memory.

    Raises:
        ReadError: if `needed` bytes are more than 256 MiB and more than 200 times the file's size.
    """
    if needed > max(_FREE, _MOST_EXPANSION * file_size):
        raise ReadError(
            f"{path} has {file_size} bytes and announces content of {needed} bytes, more than {_MOST_EXPANSION} times "
            "its size: its header is wrong or it is a decompression bomb. Export or download it again."
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
