"""Linear algebra over the field of two elements: vectors are the bits of Python's integers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]


class Span:
    """The span of some vectors, in which no two vectors have the same leading bit."""

    def __init__(self, vectors: Iterable[int] = ()) -> None:
        self._by_length: dict[int, int] = {}
        for vector in vectors:
            self.add(vector)

    def __len__(self) -> int:
        """Its dimension."""
        return len(self._by_length)

    def __iter__(self) -> Iterator[int]:
        """A basis."""
        return iter(self._by_length.values())

    def copy(self) -> Span:
        """The same span, which can grow by itself."""
        other = Span()
        other._by_length = dict(self._by_length)
        return other

    def reduced(self, vector: int) -> int:
        """The vector without what the span can take off its leading bits: 0 if it lies in the span."""
        while vector and (own := self._by_length.get(vector.bit_length())) is not None:
            vector ^= own
        return vector

    def add(self, vector: int) -> bool:
        """Whether the vector was not in the span; it is afterward."""
        if rest := self.reduced(vector):
            self._by_length[rest.bit_length()] = rest
        return rest != 0

    def annihilators(self, n_bits: int, generator: np.random.Generator) -> Words:
        """64 random functionals that vanish on the span, as the bits of one word (n_bits,) per coordinate."""
        words = generator.integers(0, 1 << 64, n_bits, np.uint64)
        for length in sorted(self._by_length):
            others = [bit for bit in bits_of(self._by_length[length]) if bit != length - 1]
            words[length - 1] = np.bitwise_xor.reduce(words[others], initial=np.uint64(0))
        return words


def bits_of(vector: int) -> list[int]:
    """The bits that are set, in ascending order."""
    return [bit for bit, digit in enumerate(reversed(f"{vector:b}")) if digit == "1"]


def from_bits(bits: Iterable[int]) -> int:
    """The vector in which these bits are set."""
    vector = 0
    for bit in bits:
        vector |= 1 << bit
    return vector


def kernel(values: Sequence[int], vectors: Sequence[int], modulo: Span | None = None) -> list[int]:
    """A basis of the combinations of vectors whose values cancel, or add up to a vector of a span.

    Args:
        values: the value of a linear map at each vector.
        vectors: as many, independent.
        modulo: a span of values that count as 0.
    """
    n_bits = max((vector.bit_length() for vector in vectors), default=0)
    seen, found = Span(value << n_bits for value in modulo or ()), []
    for value, vector in zip(values, vectors, strict=True):
        rest = seen.reduced(value << n_bits | vector)
        if rest >> n_bits:
            seen.add(rest)
        else:
            found.append(rest)
    return found
