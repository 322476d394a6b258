"""The compiled loops of a curve over levels: what changes where a voxel enters the solid as the level falls.

Voxels enter one after the other: by falling value, equal ones by rising index. What changes when a voxel enters follows
from those of its 26 neighbors that entered before. These are the bits of a mask: bit 9 (dx + 1) + 3 (dy + 1) + dz + 1
stands for the neighbor at (dx, dy, dz), so bits below 13, the voxel itself, have smaller indices.

A volume may be a block of a larger one. The faces that it shares with other blocks are open: what is beyond them is in
neither phase, as it is not known yet. Beyond the other faces is background. Bit 2 axis + side of a number stands for
the first (0) or last (1) face of an axis.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.core.blocks.compiled import compiled
from topokit.core.blocks.division import Triple
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

IS_BIRTH, IS_EVENT, BITS_OF_SOLID = 1, 2, 7
"""Bits of a class: the voxel begins a region, or perhaps joins some or is at an open face, and five bits with the
number of a neighbor of its phase that was there before, or of itself; first of the solid, then of the background. The
change of χ is above."""

_CLASS_BITS = 24
_SPREAD = np.int64(0x1E3779B97F4A7C15)  # an odd number, by which masks are spread over places


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
def classify(
    masks: Masks, x: int, shape: Triple, open_faces: int, solid_is_six: bool, known: NDArray[np.int64], classes: Masks
) -> None:
    """Write the class of each voxel of a layer.

    Args:
        masks: (Y, Z).
        x: the layer.
        shape: of the volume.
        open_faces: of the volume.
        solid_is_six: whether the solid is 6-connected; else the background is.
        known: (a power of two,) masks that were met, each with its class, by their place; a later one takes the place
            of an earlier one. −1 where there is none.
        classes: (Y, Z), where the classes are written.
    """
    _, n_y, n_z = shape
    for y in range(n_y):
        of_row = _faces_at(x, y, 0, shape) & open_faces & 15
        for z in range(n_z):
            mask, faces = masks[y, z], of_row
            if z == 0 or z == n_z - 1:
                faces = _faces_at(x, y, z, shape) & open_faces
            key = np.int64(mask) | np.int64(faces) << 27
            place = key * _SPREAD >> 44 & (len(known) - 1)
            if known[place] >> _CLASS_BITS != key:
                found = _both_classes(mask, _ALL & ~mask & ~_beyond(faces), solid_is_six)
                found |= (IS_EVENT << BITS_OF_SOLID | IS_EVENT) if faces else 0
                known[place] = key << _CLASS_BITS | found & ((1 << _CLASS_BITS) - 1)
            classes[y, z] = np.int32(known[place] << 64 - _CLASS_BITS >> 64 - _CLASS_BITS)


@compiled
def _both_classes(solid: int, background: int, solid_is_six: bool) -> int:
    """The change of χ, the class in the background and that in the solid, given the neighbors in both."""
    change = completed(solid | 1 << 13) if solid_is_six else -completed(background | 1 << 13)
    return (change << BITS_OF_SOLID | _class(background, not solid_is_six)) << BITS_OF_SOLID | _class(
        solid, solid_is_six
    )


@compiled
def link_layer(classes: Masks, x: int, shape: Triple, open_faces: int, of_background: bool, parents: Numbers) -> None:
    """Let every voxel of a layer point to a neighbor of its phase that was there before, or to itself.

    Args:
        classes: (Y, Z) of the layer.
        x: the layer.
        shape: of the volume.
        open_faces: of the volume.
        of_background: whether the phase is the background, into which voxels come in the reverse order.
        parents: of all voxels, and of what is outside the volume, which is part of the background.
    """
    _, n_y, n_z = shape
    steps = np.empty(32, np.int64)
    for bit in range(27):
        steps[bit] = _step(bit, n_y, n_z)
    shift = 2 + (BITS_OF_SOLID if of_background else 0)
    for y in range(n_y):
        start = (x * n_y + y) * n_z
        for z in range(n_z):
            parents[start + z] = start + z + steps[classes[y, z] >> shift & 31]
            if of_background and _faces_at(x, y, z, shape) & ~open_faces:
                parents[start + z] = len(parents) - 1


@compiled
def count_merges(
    voxels: NDArray[np.int64],
    masks: Masks,
    shape: Triple,
    open_faces: int,
    is_six: bool,
    of_background: bool,
    parents: Numbers,
    links: Numbers,
    merges: Bytes,
) -> int:
    """Write how many regions of a phase are joined to another one at each event, as far as no other block matters.

    A region that has reached an open face is known by one of its voxels there, its root. Where two such regions join,
    the roots are linked: blocks beyond may have joined them before.

    Args:
        voxels: (E,) indices of the events in the order in which they come into the phase: voxels that may join
            something, and those at open faces.
        masks: (E,) of these.
        shape: of the volume.
        open_faces: of the volume.
        is_six: whether the phase is 6-connected.
        of_background: as for `link_layer`.
        parents: what `link_layer` wrote for all layers; becomes a forest of regions.
        links: (voxels at open faces, 3), where linked voxels are written, and the number of the event.
        merges: (E,), where the numbers are written; one more where a region reaches an open face.

    Returns:
        How many links are written.
    """
    _, n_y, n_z = shape
    n_links = 0
    for k in range(len(voxels)):
        voxel = voxels[k]
        z, y, x = voxel % n_z, voxel // n_z % n_y, voxel // (n_y * n_z)
        faces = _faces_at(x, y, z, shape)
        link = ((_ALL & ~masks[k]) if of_background else masks[k]) & ~_beyond(faces & open_faces)
        beyond = _beyond(faces & ~open_faces) if of_background else 0
        left = link & (_FACES if is_six else _ALL)
        root = -1
        while left:
            seed = left & -left
            piece = _piece(seed, link, is_six)
            left &= ~piece
            neighbor = voxel + _step(_number(seed), n_y, n_z)
            other = root_of(parents, len(parents) - 1 if piece & beyond else neighbor)
            if root < 0 or other == root:
                root = other
                continue
            is_linked = _is_at(root, shape, open_faces) and _is_at(other, shape, open_faces)
            if _is_at(other, shape, open_faces) and (not is_linked or other == len(parents) - 1):
                root, other = other, root
            parents[other] = root
            merges[k] += not is_linked
            if is_linked:
                links[n_links, 0], links[n_links, 1], links[n_links, 2] = other, root, k
                n_links += 1
        if faces & open_faces:
            root = root_of(parents, voxel)
            if root != voxel and _is_at(root, shape, open_faces):
                links[n_links, 0], links[n_links, 1], links[n_links, 2] = voxel, root, k
                n_links += 1
            else:
                parents[voxel] = voxel
                parents[root] = voxel
                merges[k] += 1
    return n_links


@compiled
def join_regions(one: Numbers, other: Numbers, n_gone: int, parents: Numbers, results: Bytes) -> None:
    """Join the regions of two blocks along links, in the order in which these come into the phase.

    Args:
        one: (L,) nodes; becomes the lower root of each link.
        other: (L,) nodes; becomes the higher root.
        n_gone: nodes that no other block will reach; they come first.
        parents: of all nodes, each its own at first.
        results: (L,), where 1 is written if the link joins a region that is complete, and 2 if both go on.
    """
    for k in range(len(one)):
        low, high = root_of(parents, one[k]), root_of(parents, other[k])
        if low != high:
            low, high = min(low, high), max(low, high)
            parents[low] = high
            results[k] = 1 if low < n_gone else 2
            one[k], other[k] = low, high


@compiled
def sum_changes(
    values: NDArray[Any], columns: Bytes, changes: NDArray[Any], levels: NDArray[np.float64], rows: NDArray[np.int64]
) -> int:
    """Write the values above −∞ at which a sum changes, from the highest one down, and the sums above each.

    Args:
        values: (N,) ascending.
        columns: (N,) what changes there as voxels enter the solid: χ (0), pieces (1) or cavities (2).
        changes: (N,) by how much.
        levels: with room for all distinct values.
        rows: one more row, where χ, pieces, tunnels and cavities from a level on are written, and below the last one.

    Returns:
        How many levels are written.
    """
    n_levels, k = 0, len(values) - 1
    euler, pieces, cavities = 0, 0, 0
    while k >= 0 and values[k] > -np.inf:
        value = values[k]
        of_euler, of_pieces, of_cavities = 0, 0, 0
        while k >= 0 and values[k] == value:
            of_euler += changes[k] if columns[k] == 0 else 0
            of_pieces += changes[k] if columns[k] == 1 else 0
            of_cavities += changes[k] if columns[k] == 2 else 0
            k -= 1
        if of_euler != 0 or of_pieces != 0 or of_cavities != 0:
            levels[n_levels] = value
            rows[n_levels, 0], rows[n_levels, 1] = euler, pieces
            rows[n_levels, 2], rows[n_levels, 3] = pieces + cavities - euler, cavities
            n_levels += 1
        euler, pieces, cavities = euler + of_euler, pieces + of_pieces, cavities + of_cavities
    rows[n_levels, 0], rows[n_levels, 1] = euler, pieces
    rows[n_levels, 2], rows[n_levels, 3] = pieces + cavities - euler, cavities
    return n_levels


@compiled
def completed(mask: int) -> int:
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
    return (IS_EVENT if neighbors & ~_piece(first, link, is_six) else 0) | _number(first) << 2


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
def _faces_at(x: int, y: int, z: int, shape: Triple) -> int:
    """The faces of a volume at which a voxel lies."""
    faces = (1 if x == 0 else 0) | (2 if x == shape[0] - 1 else 0)
    faces |= (4 if y == 0 else 0) | (8 if y == shape[1] - 1 else 0)
    return faces | (16 if z == 0 else 0) | (32 if z == shape[2] - 1 else 0)


@compiled
def _is_at(root: int, shape: Triple, open_faces: int) -> bool:
    """Whether a voxel is at an open face, or stands for the outside of a block."""
    if open_faces == 0:
        return False
    _, n_y, n_z = shape
    z, y, x = root % n_z, root // n_z % n_y, root // (n_y * n_z)
    return x == shape[0] or _faces_at(x, y, z, shape) & open_faces != 0


@compiled
def _beyond(faces: int) -> int:
    """The neighbors of a voxel that are beyond some faces, at which it lies."""
    bits = _FIRST_X if faces & 1 else 0
    bits |= _LAST_X if faces & 2 else 0
    bits |= _FIRST_Y if faces & 4 else 0
    bits |= _LAST_Y if faces & 8 else 0
    bits |= _FIRST_Z if faces & 16 else 0
    return bits | (_LAST_Z if faces & 32 else 0)


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
