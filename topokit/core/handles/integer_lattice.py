"""Bases of integer lattices, grown one vector at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Integers


class PrimitiveBasis:
    """Integer vectors that can be completed to a basis of all integer vectors.

    Keeps a unimodular matrix U that takes the vectors chosen so far to the first unit vectors. Another vector may join
    if, after U, its remaining entries have no common divisor. Most that may not are told by their parities alone, since
    such vectors are independent modulo 2.
    """

    def __init__(self, size: int) -> None:
        self._matrix = np.eye(size, dtype=object)  # Python integers: no overflow
        self._parities: dict[int, int] = {}  # reduced parities as the bits of a number, by their highest bit
        self.count = 0

    def add(self, vector: Integers) -> bool:
        """Take a vector (n,) in if the vectors stay part of a basis; returns whether they do."""
        parity = self._reduced_parity(vector)
        if parity == 0:
            return False
        some = np.flatnonzero(vector)
        image = vector[some].astype(object) @ self._matrix[some]
        rest = image[self.count :]
        if np.gcd.reduce(rest) != 1:
            return False
        self._reduce(rest)
        self._parities[parity.bit_length()] = parity
        self.count += 1
        return True

    def _reduced_parity(self, vector: Integers) -> int:
        parity = int.from_bytes(np.packbits(vector & 1).tobytes())
        while parity and (other := self._parities.get(parity.bit_length())):
            parity ^= other
        return parity

    def _reduce(self, rest: NDArray[np.object_]) -> None:
        """Column operations after which `rest`, in place, is the first unit vector."""
        columns = self._matrix[:, self.count :]
        while True:
            some = np.flatnonzero(rest)
            pivot = some[np.argmin(np.abs(rest[some]))]
            others = some[some != pivot]
            if len(others) == 0:
                break
            quotients = rest[others] // rest[pivot]
            rest[others] -= quotients * rest[pivot]
            columns[:, others] -= quotients * columns[:, [pivot]]
        columns[:, pivot] *= rest[pivot]
        columns[:, [0, pivot]] = columns[:, [pivot, 0]]
