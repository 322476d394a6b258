"""Solids on grids as bits, 64 voxels in a word: passes over a whole volume that cost next to nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Booleans, Integers
from topokit.core.blocks.compiled import compiled

Bits = NDArray[np.uint64]

WORD = 64
"""Voxels in a word."""


def packed(solid: Booleans) -> Bits:
    """The voxels (X, Y, Z) along the last axis as bits of words, 0 beyond the end."""
    rows = np.packbits(solid, axis=2, bitorder="little")
    missing = -rows.shape[2] % 8
    words: Bits = np.ascontiguousarray(np.pad(rows, ((0, 0), (0, 0), (0, missing)))).view(np.uint64)
    return words


def voxels_of(bits: Bits, length: int) -> Integers:
    """Flat indices (N,) of the voxels that are set, in a volume so long along the last axis."""
    return _voxels_of(bits.reshape(-1, bits.shape[2]), length)


@compiled
def _voxels_of(rows: Bits, length: int) -> Integers:
    """Those of rows (R, W) of words; counted first, so that no array grows."""
    count = 0
    for row in range(len(rows)):
        for word in rows[row]:
            while word:
                word &= word - np.uint64(1)
                count += 1
    found = np.empty(count, dtype=np.int64)
    for row in range(len(rows) - 1, -1, -1):
        for at in range(rows.shape[1] - 1, -1, -1):
            word = rows[row, at]
            for bit in range(WORD - 1, -1, -1):
                if word == 0:
                    break
                if word >> np.uint64(bit) & np.uint64(1):
                    count -= 1
                    found[count] = row * length + at * WORD + bit
                    word ^= np.uint64(1) << np.uint64(bit)
    return found


@compiled
def of_voxels(voxels: Integers, shape: tuple[int, int, int]) -> Bits:
    """A volume in which some voxels, given by their flat indices (N,), are set."""
    rows = np.zeros((shape[0] * shape[1], (shape[2] + WORD - 1) // WORD), dtype=np.uint64)
    for voxel in voxels:
        row, z = voxel // shape[2], voxel % shape[2]
        rows[row, z // WORD] |= np.uint64(1) << np.uint64(z % WORD)
    return rows.reshape(shape[0], shape[1], -1)


def are_set(bits: Bits, voxels: Integers, length: int) -> Booleans:
    """Whether each of some voxels, given by flat indices (N,) in a volume so long along the last axis, is set."""
    row, z = np.divmod(voxels, length)
    found: Booleans = bits.reshape(-1, bits.shape[2])[row, z // WORD] >> (z % WORD).astype(np.uint64) & 1 == 1
    return found


def changes(bits: Bits, length: int) -> Bits:
    """The voxels that are unlike the one before along the last axis, which is so long, and the first of each row."""
    row = packed(np.ones((1, 1, length), dtype=bool))
    found = (bits ^ _ahead(bits, 2, -1)) & row
    found[:, :, 0] |= np.uint64(1)
    return found


def widened(bits: Bits, axis: int, before: int, after: int) -> Bits:
    """Every voxel that has a set one among so many before it and after it along an axis, or is set."""
    return _reached(_reached(bits, axis, 1, after), axis, -1, before)


def _reached(bits: Bits, axis: int, sense: int, steps: int) -> Bits:
    """The voxels from which a set one is at most so many steps ahead."""
    done = 0
    while done < steps:
        more = min(done + 1, steps - done)
        bits = bits | _ahead(bits, axis, sense * more)
        done += more
    return bits


def _ahead(bits: Bits, axis: int, steps: int) -> Bits:
    """What is so many steps ahead of every voxel, 0 beyond the ends."""
    if axis < 2:
        return _moved(bits, axis, steps)
    words, rest = divmod(steps, WORD)
    first = _moved(bits, 2, words)
    if rest == 0:
        return first
    return (first >> np.uint64(rest)) | (_moved(bits, 2, words + 1) << np.uint64(WORD - rest))


def _moved(bits: Bits, axis: int, steps: int) -> Bits:
    if steps == 0:
        return bits
    result = np.zeros_like(bits)
    target, source = np.moveaxis(result, axis, 0), np.moveaxis(bits, axis, 0)
    if steps > 0:
        target[:-steps] = source[steps:]
    else:
        target[-steps:] = source[:steps]
    return result
