"""Simple points of a solid on a 3D grid: the voxels that can be added or removed without changing its topology.

Whether a voxel is simple is decided by its 26 neighbours alone: it is, exactly when the solid among them has one
component that touches the voxel and the background has one, each in its own connectivity. The 3 x 3 x 3 neighbourhood
is held in the bits of one integer, so that growing a component by one step is a few shifts, for all voxels at once.

Reference:
    G. Bertrand, G. Malandain, "A new characterization of three-dimensional simple points", Pattern Recognition Letters
    15, 1994, doi:10.1016/0167-8655(94)90046-9.
"""

from __future__ import annotations

from itertools import compress, product

import numpy as np
from numpy.typing import NDArray

from topokit.errors import InputError

Codes = NDArray[np.int32]
Bools = NDArray[np.bool_]
Indices = NDArray[np.signedinteger]
Counts = NDArray[np.int8]

OFFSETS: Indices = np.array(list(product((-1, 0, 1), repeat=3)))
"""(27, 3): where the voxel of bit 9 (x + 1) + 3 (y + 1) + (z + 1) lies."""

_STEPS = np.abs(OFFSETS).sum(1)  # 1 across a face, 2 across an edge, 3 across a corner


def _bits(chosen: Bools) -> np.int32:
    return np.int32(sum(1 << k for k in np.flatnonzero(chosen)))


_ALL = _bits(_STEPS >= 0)
_FACES = _bits(_STEPS == 1)
_FACES_AND_EDGES = _bits((_STEPS == 1) | (_STEPS == 2))
_AROUND = _bits(_STEPS > 0)
_AXES = [  # shift along an axis, and the bits from which it stays in the neighbourhood: upwards, downwards
    (np.int32(shift), _bits(OFFSETS[:, axis] < 1), _bits(OFFSETS[:, axis] > -1)) for axis, shift in enumerate((9, 3, 1))
]


class PaddedSolid:
    """A solid in a flat array with one layer of background around it, so that every voxel has 26 neighbours.

    Attributes:
        inside: (M,) uint8, 1 inside; may be written to.
    """

    def __init__(self, solid: Bools) -> None:
        padded = np.pad(solid, 1)
        self._shape = padded.shape
        self.inside = padded.ravel().view(np.uint8)
        strides = np.array([padded.shape[1] * padded.shape[2], padded.shape[2], 1])
        self._around: list[int] = (OFFSETS @ strides).tolist()

    def solid(self) -> Bools:
        """The solid (X, Y, Z), a copy."""
        return self.inside.reshape(self._shape)[1:-1, 1:-1, 1:-1].astype(bool)

    def indices(self, where: Bools) -> Indices:
        """Flat indices into `inside` of the voxels (X, Y, Z) that are True."""
        found = np.flatnonzero(np.pad(where, 1))
        return found if self.inside.size > np.iinfo(np.int32).max else found.astype(np.int32)

    def parity(self, at: Indices) -> Counts:
        """0..7: voxels of the same parity are not among each other's 26 neighbours."""
        _, n_y, n_z = self._shape
        x, y, z = ((number & 1).astype(np.int8) for number in (at // (n_y * n_z), at // n_z % n_y, at % n_z))
        return 4 * x + 2 * y + z

    def on_surface(self, at: Indices, through_faces: bool) -> Bools:
        """Whether a neighbour is of the other kind.

        A simple voxel always has such a neighbour: one across a face if it is simple in both connectivities, else one
        of the 26.
        """
        own = self.inside[at]
        differs = np.zeros(len(at), dtype=bool)
        for step in compress(self._around, _STEPS == 1) if through_faces else self._around:
            differs |= self.inside[at + step] != own
        return differs

    def codes(self, at: Indices) -> Codes:
        """The neighbourhoods of flat indices (N,), as integers of 27 bits."""
        codes = np.zeros(len(at), dtype=np.int32)
        for bit, step in enumerate(self._around):
            codes |= self.inside[at + step].astype(np.int32) << np.int32(bit)
        return codes


def is_simple(codes: Codes, connectivity: int | None = None) -> Bools:
    """Whether the middle voxel can change sides without changing the solid's topology.

    Args:
        codes: (N,) neighbourhoods from `PaddedSolid.codes`; the middle bit does not matter.
        connectivity: 6 or 26, that of the solid; None for simple in both.

    Returns:
        (N,) bool.

    Raises:
        InputError: for another connectivity.
    """
    if connectivity not in (6, 26, None):
        raise InputError(f"connectivity must be 6, 26 or None (both), not {connectivity!r}.")
    simple = np.ones(len(codes), dtype=bool)
    for one in (6, 26) if connectivity is None else (connectivity,):
        solid, background = touching(codes, one)
        simple &= (solid == 1) & (background == 1)
    return simple


def touching(codes: Codes, connectivity: int) -> tuple[Counts, Counts]:
    """Components of the solid and of the background around the middle voxel that touch it: 0, 1, or 2 for more.

    Args:
        codes: (N,) neighbourhoods.
        connectivity: 6 or 26, that of the solid; the background has the other one.

    Returns:
        Two (N,) int8 arrays.
    """
    background = ~codes & _ALL
    if connectivity == 6:
        return _through_faces(codes), _through_corners(background)
    return _through_corners(codes), _through_faces(background)


def _through_faces(codes: Codes) -> Counts:
    """6-components in the 18-neighbourhood that share a face with the middle."""
    around, faces = codes & _FACES_AND_EDGES, codes & _FACES
    reached = faces & -faces  # the lowest bit
    while True:
        grown = reached.copy()
        for shift, up, down in _AXES:
            grown |= ((reached & up) << shift) | ((reached & down) >> shift)
        grown &= around
        if np.array_equal(grown, reached):
            return _count(faces, reached)
        reached = grown


def _through_corners(codes: Codes) -> Counts:
    """26-components in the 26-neighbourhood."""
    around = codes & _AROUND
    reached = around & -around
    while True:
        grown = reached
        for shift, up, down in _AXES:  # axis after axis: edges and corners are steps along two or three
            grown = grown | ((grown & up) << shift) | ((grown & down) >> shift)
        grown &= around
        if np.array_equal(grown, reached):
            return _count(around, reached)
        reached = grown


def _count(all_of_them: Codes, in_first: Codes) -> Counts:
    return (all_of_them != 0).astype(np.int8) + ((all_of_them & ~in_first) != 0)
