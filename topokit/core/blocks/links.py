"""The compiled loops of a curve over levels: what changes where a voxel enters the solid as the level falls.

Voxels enter one after the other: by falling value, equal ones by rising index. What changes when a voxel enters follows
from those of its 26 neighbors that entered before. These are the bits of a mask: bit 9 (dx + 1) + 3 (dy + 1) + dz + 1
stands for the neighbor at (dx, dy, dz), so bits below 13, the voxel itself, have smaller indices.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.core.blocks.compiled import compiled
from topokit.core.blocks.planes import root_of

Masks = NDArray[np.int32]
Numbers = NDArray[np.int32]
Bytes = NDArray[np.int8]

_ALL = (1 << 27) - 1 - (1 << 13)
_FACES = 1 << 4 | 1 << 10 | 1 << 12 | 1 << 14 | 1 << 16 | 1 << 22
_FIRST_X, _LAST_X = 0x1FF, 0x1FF << 18
_FIRST_Y, _LAST_Y = 0o7 | 0o7 << 9 | 0o7 << 18, 0o7 << 6 | 0o7 << 15 | 0o7 << 24
_FIRST_Z, _LAST_Z = sum(1 << 3 * k for k in range(9)), sum(4 << 3 * k for k in range(9))
_NOT_FIRST_Y, _NOT_LAST_Y = (1 << 27) - 1 - _FIRST_Y, (1 << 27) - 1 - _LAST_Y
_NOT_FIRST_Z, _NOT_LAST_Z = (1 << 27) - 1 - _FIRST_Z, (1 << 27) - 1 - _LAST_Z
_SQUARES = (1 << 1 | 1 << 4 | 1 << 10 | 1 << 13, 1 << 3 | 1 << 4 | 1 << 12 | 1 << 13, 1 << 9 | 1 << 10 | 3 << 12)
_CUBES = 1 | 1 << 1 | 1 << 3 | 1 << 4 | 1 << 9 | 1 << 10 | 3 << 12  # the lowest voxel of each of eight

IS_BIRTH, IS_SADDLE, BITS_OF_SOLID = 1, 2, 7
"""Bits of a class: the voxel begins a region, or perhaps joins some, and five bits with the number of a neighbor of its
phase that was there before, or of itself; first of the solid, then of the background. The change of χ is above."""


@compiled
def entered_before(values: NDArray[Any], x: int, masks: Masks) -> None:
    """Write the masks of the voxels of a layer (Y, Z) of values (X, Y, Z)."""
    n_x, n_y, n_z = values.shape
    masks[:] = 0
    for y in range(n_y):
        for bit in range(27):
            dx, dy, dz = bit // 9 - 1, bit // 3 % 3 - 1, bit % 3 - 1
            if bit == 13 or not (0 <= x + dx < n_x and 0 <= y + dy < n_y):
                continue
            start, stop = max(0, -dz), n_z - max(0, dz)
            own, mask = values[x, y, start:stop], masks[y, start:stop]
            other = values[x + dx, y + dy, start + dz : stop + dz]
            if bit < 13:
                for z in range(len(mask)):
                    mask[z] |= np.int32(other[z] >= own[z]) << bit
            else:
                for z in range(len(mask)):
                    mask[z] |= np.int32(other[z] > own[z]) << bit


@compiled
def classify(masks: Masks, solid_is_six: bool, known: Masks, results: Masks, classes: Masks) -> None:
    """Write the class of each voxel of a layer.

    Args:
        masks: (Y, Z).
        solid_is_six: whether the solid is 6-connected; else the background is.
        known: (a power of two,) masks that were met, by their place; a later one takes the place of an earlier one.
        results: likewise their classes.
        classes: (Y, Z), where the classes are written.
    """
    for y in range(masks.shape[0]):
        for z in range(masks.shape[1]):
            mask = masks[y, z]
            place = (mask ^ mask >> 11) & (len(known) - 1)
            if known[place] != mask:
                change = _index((mask if solid_is_six else _ALL & ~mask) | 1 << 13)
                solid, background = _class(mask, solid_is_six), _class(_ALL & ~mask, not solid_is_six)
                known[place] = mask
                results[place] = ((change if solid_is_six else -change) << 7 | background) << BITS_OF_SOLID | solid
            classes[y, z] = results[place]


@compiled
def link_layer(classes: Masks, x: int, n_x: int, of_background: bool, parents: Numbers) -> None:
    """Let every voxel of a layer point to a neighbor of its phase that was there before, or to itself.

    Args:
        classes: (Y, Z) of layer x of n_x.
        x: the layer.
        n_x: layers in all.
        of_background: whether the phase is the background, into which voxels come in the reverse order.
        parents: of all voxels, and of what is outside the volume, which is part of the background.
    """
    n_y, n_z = classes.shape
    steps = np.empty(32, np.int64)
    for bit in range(27):
        steps[bit] = _step(bit, n_y, n_z)
    shift = 2 + (BITS_OF_SOLID if of_background else 0)
    for y in range(n_y):
        at_end = of_background and (x == 0 or x == n_x - 1 or y == 0 or y == n_y - 1)
        start = (x * n_y + y) * n_z
        for z in range(n_z):
            parents[start + z] = start + z + steps[classes[y, z] >> shift & 31]
            if at_end or (of_background and (z == 0 or z == n_z - 1)):
                parents[start + z] = len(parents) - 1


@compiled
def count_merges(
    voxels: NDArray[np.int64],
    masks: Masks,
    shape: tuple[int, int, int],
    is_six: bool,
    of_background: bool,
    parents: Numbers,
    merges: Bytes,
) -> None:
    """Write how many regions of a phase each saddle joins to another one.

    Args:
        voxels: (S,) indices of the saddles in the order in which they come into the phase.
        masks: (S,) of these.
        shape: of the volume.
        is_six: whether the phase is 6-connected.
        of_background: as for `link_layer`.
        parents: what `link_layer` wrote for all layers; becomes a forest of regions.
        merges: (S,), where the numbers are written.
    """
    n_x, n_y, n_z = shape
    for k in range(len(voxels)):
        voxel = voxels[k]
        z, y, x = voxel % n_z, voxel // n_z % n_y, voxel // (n_y * n_z)
        link = (_ALL & ~masks[k]) if of_background else masks[k]
        beyond = _beyond(x, y, z, n_x, n_y, n_z) if of_background else 0
        left = link & (_FACES if is_six else _ALL)
        root = -1
        while left:
            seed = left & -left
            piece = _piece(seed, link, is_six)
            left &= ~piece
            neighbor = voxel + _step(_number(seed), n_y, n_z)
            other = root_of(parents, len(parents) - 1 if piece & beyond else neighbor)
            if root < 0:
                root = other
            elif other != root:
                parents[other] = root
                merges[k] += 1


@compiled
def _index(mask: int) -> int:
    """1 − edges + squares − cubes that a voxel completes, of a mask with the voxel itself."""
    along_z = mask & mask >> 1
    along_y = mask & mask >> 3
    squares = np.int64(along_y & along_y >> 9 & _SQUARES[0])
    squares |= np.int64(along_z & along_z >> 9 & _SQUARES[1]) << 16
    block = along_z & along_z >> 3
    squares |= np.int64(block & _SQUARES[2]) << 32
    others = np.int64(mask & _FACES) | np.int64(block & block >> 9 & _CUBES) << 32
    return 1 + _n_bits(squares) - _n_bits(others)


@compiled
def _n_bits(word: np.int64) -> int:
    word -= word >> 1 & 0x5555555555555555
    word = (word & 0x3333333333333333) + (word >> 2 & 0x3333333333333333)
    word = (word + (word >> 4)) & 0x0F0F0F0F0F0F0F0F
    word += word >> 8
    word += word >> 16
    return int((word + (word >> 32)) & 127)


@compiled
def _class(link: int, is_six: bool) -> int:
    """Whether a voxel begins a region of its phase, or has neighbors in it that do not touch around it; and one."""
    neighbors = link & (_FACES if is_six else _ALL)
    if neighbors == 0:
        return IS_BIRTH | 13 << 2
    first = neighbors & -neighbors
    return (IS_SADDLE if neighbors & ~_piece(first, link, is_six) else 0) | _number(first) << 2


@compiled
def _piece(piece: int, link: int, is_six: bool) -> int:
    """The voxels of a link that are joined to some of them within it."""
    while True:
        z = piece | (piece << 1 & _NOT_FIRST_Z) | (piece >> 1 & _NOT_LAST_Z)
        source = piece if is_six else z
        y = source | (source << 3 & _NOT_FIRST_Y) | (source >> 3 & _NOT_LAST_Y)
        source = piece if is_six else y
        grown = (z | y | source | source << 9 | source >> 9) & link
        if grown == piece:
            return piece
        piece = grown


@compiled
def _beyond(x: int, y: int, z: int, n_x: int, n_y: int, n_z: int) -> int:
    """The neighbors of a voxel that are outside the volume."""
    bits = _FIRST_X if x == 0 else 0
    bits |= _LAST_X if x == n_x - 1 else 0
    bits |= _FIRST_Y if y == 0 else 0
    bits |= _LAST_Y if y == n_y - 1 else 0
    bits |= _FIRST_Z if z == 0 else 0
    return bits | (_LAST_Z if z == n_z - 1 else 0)


@compiled
def _number(bit: int) -> int:
    number = 0
    while bit > 1:
        bit >>= 1
        number += 1
    return number


@compiled
def _step(number: int, n_y: int, n_z: int) -> int:
    """How far the index of a neighbor is from that of its voxel."""
    return ((number // 9 - 1) * n_y + number // 3 % 3 - 1) * n_z + number % 3 - 1
