"""How a volume is divided into blocks, and in which order their parts are joined."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise, product
from math import prod
from typing import TypeVar

Triple = tuple[int, int, int]
Box = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
Found = TypeVar("Found")

MOST_VOXELS = (
    1 << 24
)  # in a block, unless a chunk has more: 16 MiB of labels, where reading and counting are in balance


@dataclass(frozen=True)
class Division:
    """A volume divided by planes into blocks.

    Attributes:
        cuts: for each axis, the index of the first layer of every block and then the number of layers.
    """

    cuts: tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]

    @classmethod
    def of(cls, chunks: Sequence[Sequence[int]], most_voxels: int = MOST_VOXELS) -> Division:
        """Blocks of whole chunks, nearly cubic, so that no chunk is read twice.

        Args:
            chunks: for each axis, the lengths of the chunks in which the volume is stored.
            most_voxels: in a block; one chunk may have more.
        """
        sides = [max(lengths) for lengths in chunks]
        ends = [sum(lengths) for lengths in chunks]
        while True:
            open_axes = [axis for axis in range(3) if sides[axis] < ends[axis]]
            axis = min(open_axes, key=sides.__getitem__, default=0)
            if not open_axes or 2 * prod(sides) > most_voxels:
                break
            sides[axis] *= 2
        x, y, z = (_cuts(lengths, side) for lengths, side in zip(chunks, sides, strict=True))
        return cls((x, y, z))

    @classmethod
    def even(cls, shape: Sequence[int], most_voxels: int) -> Division:
        """Nearly cubic blocks of nearly equal size, of a volume that is stored nowhere.

        Args:
            shape: of the volume.
            most_voxels: in a block.
        """
        n_blocks = [1, 1, 1]
        while prod(-(-n // k) for n, k in zip(shape, n_blocks, strict=True)) > most_voxels:
            longest = max(range(3), key=lambda axis: shape[axis] / n_blocks[axis])
            n_blocks[longest] += 1
        x, y, z = (tuple(n * i // k for i in range(k + 1)) for n, k in zip(shape, n_blocks, strict=True))
        return cls((x, y, z))

    @property
    def shape(self) -> Triple:
        """Of the volume."""
        x, y, z = (cuts[-1] for cuts in self.cuts)
        return x, y, z

    @property
    def n_blocks(self) -> int:
        """Blocks in all."""
        return prod(len(cuts) - 1 for cuts in self.cuts)

    @property
    def boxes(self) -> list[Box]:
        """First and last + 1 voxel of every block."""
        return [(x, y, z) for x, y, z in product(*map(pairwise, self.cuts))]

    def reduce(self, count: Callable[[Box], Found], join: Callable[[Found, Found, int], Found]) -> Found:
        """Count every block and join what was found, two neighbors at a time, until one is left.

        Blocks are visited so that few results wait to be joined: as many as the logarithm of their number.

        Args:
            count: what is found in a block, given by its first and last + 1 voxel along each axis.
            join: joins two findings along an axis.
        """

        def reduced(blocks: Box) -> Found:
            n_along = [stop - start for start, stop in blocks]
            axis = n_along.index(max(n_along))
            if n_along[axis] == 1:
                x, y, z = ((cuts[start], cuts[stop]) for cuts, (start, stop) in zip(self.cuts, blocks, strict=True))
                return count((x, y, z))
            start, stop = blocks[axis]
            halves = (start, (start + stop) // 2), ((start + stop) // 2, stop)
            first, second = ((*blocks[:axis], half, *blocks[axis + 1 :]) for half in halves)
            return join(reduced(first), reduced(second), axis)  # type: ignore[arg-type]

        x, y, z = ((0, len(cuts) - 1) for cuts in self.cuts)
        return reduced((x, y, z))


def _cuts(lengths: Sequence[int], side: int) -> tuple[int, ...]:
    """Ends of chunks that are about a side apart."""
    cuts = [0]
    ends = list(accumulate(lengths))
    for end, following in zip(ends, [*ends[1:], 0], strict=True):
        if following == 0 or following - cuts[-1] > side:
            cuts.append(end)
    return tuple(cuts)
