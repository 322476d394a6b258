"""Simple points of a solid on a 3D grid: the voxels that can be added or removed without changing its topology.

A voxel is simple if and only if, among its 26 neighbors, exactly one component of the solid and one of the background
touch it, each in its own connectivity. The 3 x 3 x 3 neighborhood is stored in the bits of one integer, so growing a
component by one step takes a few shifts.

Reference:
    G. Bertrand, G. Malandain, "A new characterization of three-dimensional simple points", Pattern Recognition Letters
    15, 1994, doi:10.1016/0167-8655(94)90046-9.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Booleans
from topokit.core.blocks.compiled import compiled
from topokit.errors import InputError

Codes = NDArray[np.int32]
Indices = NDArray[np.signedinteger]
Counts = NDArray[np.int8]

OFFSETS: Indices = np.array(list(product((-1, 0, 1), repeat=3)))
"""(27, 3): bit 9 (x + 1) + 3 (y + 1) + (z + 1) of a code is the voxel at offset (x, y, z)."""

_STEPS = np.abs(OFFSETS).sum(1)  # 1 across a face, 2 across an edge, 3 across a corner


def _bits(chosen: Booleans) -> int:
    """Code with the chosen bits set."""
    return sum(1 << int(k) for k in np.flatnonzero(chosen))


_ALL = _bits(_STEPS >= 0)
_FACES = _bits(_STEPS == 1)
_FACES_AND_EDGES = _bits((_STEPS == 1) | (_STEPS == 2))
_AROUND = _bits(_STEPS > 0)
_UP = tuple(_bits(OFFSETS[:, axis] < 1) for axis in range(3))  # bits that stay when shifted up along an axis
_DOWN = tuple(_bits(OFFSETS[:, axis] > -1) for axis in range(3))  # and when shifted down
_SHIFTS = (9, 3, 1)


class PaddedSolid:
    """A solid in a flat array with one layer of background around it, so that every voxel has 26 neighbors.

    Attributes:
        inside: (M,) uint8, 1 inside; writable.
    """

    def __init__(self, solid: Booleans) -> None:
        padded = np.pad(solid, 1)
        self._shape = padded.shape
        self.inside = padded.ravel().view(np.uint8)
        strides = np.array([padded.shape[1] * padded.shape[2], padded.shape[2], 1])
        self._around: Indices = OFFSETS @ strides

    def solid(self) -> Booleans:
        """The solid (X, Y, Z), a copy."""
        return self.inside.reshape(self._shape)[1:-1, 1:-1, 1:-1].astype(bool)

    def indices(self, where: Booleans) -> Indices:
        """Flat indices into `inside` of the voxels (X, Y, Z) that are True."""
        found = np.flatnonzero(np.pad(where, 1))
        return found if self.inside.size > np.iinfo(np.int32).max else found.astype(np.int32)

    def parity(self, at: Indices) -> Counts:
        """Class 0..7 of each voxel; voxels of one class are never among each other's 26 neighbors."""
        _, n_y, n_z = self._shape
        x, y, z = ((number & 1).astype(np.int8) for number in (at // (n_y * n_z), at // n_z % n_y, at % n_z))
        return 4 * x + 2 * y + z

    def on_surface(self, at: Indices, through_faces: bool) -> Booleans:
        """Whether a neighbor is on the other side of the surface.

        A simple voxel always has such a neighbor: across a face if it is simple in both connectivities, else among the
        26.
        """
        own = self.inside[at]
        differs = np.zeros(len(at), dtype=bool)
        for step in (self._around[_STEPS == 1] if through_faces else self._around).tolist():
            differs |= self.inside[at + step] != own
        return differs

    def codes(self, at: Indices) -> Codes:
        """Neighborhoods of the voxels at flat indices (N,), as codes of 27 bits."""
        return _codes(self.inside, at, self._around)

    def flip_simple(self, at: Indices, connectivity: int | None) -> Booleans:
        """Flip those of the voxels at flat indices (N,) that are simple, one after the other; which ones were, (N,)."""
        return _flip_simple(self.inside, at, self._around, _both(connectivity))


def is_simple(codes: Codes, connectivity: int | None = None) -> Booleans:
    """Whether the middle voxel can be flipped without changing the solid's topology.

    Args:
        codes: (N,) neighborhoods from `PaddedSolid.codes`; the middle bit is ignored.
        connectivity: 6 or 26, that of the solid; None for simple in both.

    Returns:
        (N,) bool.

    Raises:
        InputError: if the connectivity is neither 6, 26 nor None.
    """
    return _all_simple(codes, _both(connectivity))


def _both(connectivity: int | None) -> tuple[int, int]:
    """The connectivities in which a voxel has to be simple, twice the same if there is one.

    Raises:
        InputError: if the connectivity is neither 6, 26 nor None.
    """
    if connectivity not in (6, 26, None):
        raise InputError(f"connectivity must be 6, 26 or None (both), not {connectivity!r}.")
    return (6, 26) if connectivity is None else (connectivity, connectivity)


def count_touching(codes: Codes, connectivity: int) -> tuple[Counts, Counts]:
    """Number of components of the solid, and of the background, that touch the middle voxel: 0, 1, or 2 for more.

    Args:
        codes: (N,) neighborhoods.
        connectivity: 6 or 26, that of the solid; the background has the other one.

    Returns:
        Two (N,) int8 arrays.
    """
    solid, background = _count_all(codes, connectivity)
    return np.minimum(solid, 2), np.minimum(background, 2)


@compiled
def _count_all(codes: Codes, connectivity: int) -> tuple[Counts, Counts]:
    solid = np.empty(len(codes), dtype=np.int8)
    background = np.empty(len(codes), dtype=np.int8)
    for row in range(len(codes)):
        solid[row] = n_touching(codes[row], connectivity)
        background[row] = n_touching(exchanged(codes[row]), 32 - connectivity)
    return solid, background


@compiled
def _codes(inside: NDArray[np.uint8], at: Indices, around: Indices) -> Codes:
    codes = np.empty(len(at), dtype=np.int32)
    for row in range(len(at)):
        codes[row] = code_at(inside, at[row], around)
    return codes


@compiled
def _all_simple(codes: Codes, connectivities: tuple[int, int]) -> Booleans:
    simple = np.empty(len(codes), dtype=np.bool_)
    for row in range(len(codes)):
        simple[row] = _is_simple(codes[row], connectivities)
    return simple


@compiled
def _flip_simple(inside: NDArray[np.uint8], at: Indices, around: Indices, both: tuple[int, int]) -> Booleans:
    flipped = np.zeros(len(at), dtype=np.bool_)
    for row in range(len(at)):
        if _is_simple(code_at(inside, at[row], around), both):
            inside[at[row]] ^= 1
            flipped[row] = True
    return flipped


@compiled
def code_at(inside: Counts | NDArray[np.uint8], voxel: int, around: Indices) -> int:
    """The neighborhood of a voxel as a code of 27 bits."""
    code = 0
    for bit in range(27):
        code |= int(inside[voxel + around[bit]]) << bit
    return code


@compiled
def exchanged(code: int) -> int:
    """The neighborhood with solid and background exchanged."""
    return _ALL & ~code


@compiled
def is_simple_in(code: int, connectivity: int) -> bool:
    """Whether a voxel with some neighborhood is simple in one connectivity, 6 or 26."""
    return bool(n_touching(code, connectivity) == 1 and n_touching(exchanged(code), 32 - connectivity) == 1)


@compiled
def _is_simple(code: int, both: tuple[int, int]) -> bool:
    return bool(is_simple_in(code, both[0]) and (both[0] == both[1] or is_simple_in(code, both[1])))


@compiled
def n_touching(code: int, connectivity: int) -> int:
    """How many components of the set bits touch the middle voxel, 6- or 26-connected; it is ignored itself.

    Of connectivity 6 those in the 18-neighborhood that share a face with the middle voxel, of 26 those in the 26.
    """
    left, count = touching(code, connectivity), 0
    while left:
        left &= ~component(code, left & -left, connectivity)
        count += 1
    return count


@compiled
def touching(code: int, connectivity: int) -> int:
    """The set bits that are joined to the middle voxel itself."""
    return code & (_FACES if connectivity == 6 else _AROUND)


@compiled
def component(code: int, seed: int, connectivity: int) -> int:
    """The set bits around the middle voxel that are joined to the seed."""
    within = code & (_FACES_AND_EDGES if connectivity == 6 else _AROUND)
    grown = seed
    while True:
        seed = grown
        for axis in range(3):  # a step across an edge or a corner is one along two or three axes
            source = seed if connectivity == 6 else grown
            grown |= ((source & _UP[axis]) << _SHIFTS[axis]) | ((source & _DOWN[axis]) >> _SHIFTS[axis])
        grown &= within
        if grown == seed:
            return seed
