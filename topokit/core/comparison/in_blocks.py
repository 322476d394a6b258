"""Which parts and cavities two solids have in common, block by block: volumes of any size.

Both solids and their union are counted as `blocks` counts any solid. Every region of a solid lies in one region of the
union, and every region of the union's background lies in one of either background. Which, is found in each block, and
kept when blocks are joined. What matches follows as in `regions`. Tunnels would need cycles across blocks, and are only
counted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from topokit.core.arrays import Booleans, Integers
from topokit.core.blocks.division import Box, Triple
from topokit.core.blocks.part import Labels, Part, count_labeled_box, joined_and_numbers
from topokit.core.blocks.whole import counted_volume
from topokit.core.grid.grid import Grid
from topokit.core.labels import connected_labels

Three = tuple[Part, Part, Part]


@dataclass(frozen=True, eq=False)
class PairPart:
    """A box of two volumes, counted.

    Attributes:
        parts: of the first solid, of the second, and of their union.
        links: for each solid the pairs (M, 2) of a region of it and one of the union, of the same phase, that share
            voxels.
    """

    parts: Three
    links: tuple[Integers, Integers]

    def without_faces(self) -> PairPart:
        """The part as far as it is counted, without what only joining needs."""
        one, other, union = (part.without_faces() for part in self.parts)
        return replace(self, parts=(one, other, union))


@dataclass(frozen=True)
class PairCount:
    """What is counted of two solids block by block.

    Attributes:
        first, second: parts, tunnels and cavities of the solids.
        matched: parts and cavities that they have in common.
    """

    first: Triple
    second: Triple
    matched: tuple[int, int]


def count_pair(first: Booleans, second: Booleans, box: Box, shape: Triple, connectivity: int) -> PairPart:
    """The part of one block of two volumes; arguments as for `blocks.part.count_box`."""
    found = [count_labeled_box(solid, box, shape, connectivity) for solid in (first, second, first | second)]
    parts, labels = zip(*found, strict=True)
    one, other = (_links(own, labels[2]) for own in labels[:2])
    return PairPart(parts, (one, other))


def join_pairs(one: PairPart, other: PairPart, axis: int) -> PairPart:
    """The part of two boxes that lie side by side; arguments as for `blocks.part.join_parts`."""
    joined = [joined_and_numbers(*parts, axis) for parts in zip(one.parts, other.parts, strict=True)]
    first, second, union = (part for part, _ in joined)
    links = []
    for side in (0, 1):
        shift = len(one.parts[side].nodes), len(one.parts[2].nodes)
        rows = np.concatenate((one.links[side], other.links[side] + shift))
        links.append(_unique(np.stack((joined[side][1][rows[:, 0]], joined[2][1][rows[:, 1]]), axis=1)))
    return PairPart((first, second, union), (links[0], links[1]))


def counted_pair(found: PairPart, shape: Triple, connectivity: int) -> PairCount:
    """What the part of two whole volumes says about them.

    Args:
        found: of both with one layer of background around them.
        shape: of the volumes without that layer.
        connectivity: 6 or 26, that of the solids.
    """
    first, second = (_betti(part, shape, connectivity) for part in found.parts[:2])
    is_solid = found.parts[2].is_six == (connectivity == 6)
    one, other = (rows[is_solid[rows[:, 1]], 1] for rows in found.links)
    return PairCount(first, second, (len(np.intersect1d(one, other)), _linked_cavities(found, is_solid)))


def _linked_cavities(found: PairPart, is_solid: Booleans) -> int:
    """Classes of regions of both backgrounds, linked by those of the union's, without the one of the outside."""
    sizes = [len(part.nodes) for part in found.parts]
    rows = [own[~is_solid[own[:, 1]]] for own in found.links]
    ends = np.concatenate((rows[0][:, 0], sizes[0] + rows[1][:, 0]))
    union = np.concatenate([sizes[0] + sizes[1] + own[:, 1] for own in rows])
    classes = connected_labels(sum(sizes), ends, union)
    return len(np.unique(classes[union])) - 1


def _betti(part: Part, shape: Triple, connectivity: int) -> Triple:
    x, y, z = counted_volume(part, connectivity, Grid(shape)).solid_betti.sum(0).tolist()
    return x, y, z


def _links(own: Labels, union: Labels) -> Integers:
    """The pairs of regions of the same phase that share voxels."""
    common = (own > 0) == (union > 0)
    codes = np.abs(own[common]).astype(np.int64) << 32 | np.abs(union[common])
    codes = np.unique(codes)
    return np.stack((codes >> 32, codes & 0xFFFFFFFF), axis=1) - 1


def _unique(rows: Integers) -> Integers:
    codes = np.unique(rows[:, 0].astype(np.int64) << 32 | rows[:, 1])
    return np.stack((codes >> 32, codes & 0xFFFFFFFF), axis=1)
