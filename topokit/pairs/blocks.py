"""Two volumes of any size compared block by block: `topokit.compare_blocks(prediction, truth)`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from topokit.adapters.voxels.adapter import as_labels, as_number, check_choice
from topokit.adapters.voxels.chosen_part import Entry
from topokit.adapters.voxels.counting import Seen, Solid
from topokit.adapters.voxels.larger_than_memory import Blocks, blocks_of
from topokit.adapters.voxels.masks import check_mask
from topokit.comparison.blocks import BlockComparison
from topokit.core.blocks.division import MOST_VOXELS, Box
from topokit.core.blocks.on_dask import reduced
from topokit.core.comparison.in_blocks import PairPart, count_pair, counted_pair, join_pairs
from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, check_connectivity
from topokit.errors import InputError

_MOST_VOXELS = MOST_VOXELS // 4  # in a block: three volumes and their labels are held at once


class _Found(NamedTuple):
    """What was found in a box of both volumes.

    Attributes:
        part: their regions.
        seen: the values of each.
        sizes: voxels in both solids, and in one and the other added up.
    """

    part: PairPart
    seen: tuple[Seen, Seen]
    sizes: tuple[int, int]


def compare_blocks(
    a: Any,
    b: Any,
    *,
    ignore: float | None = None,
    level: float | None = None,
    label: float | tuple[float, ...] | None = None,
    connectivity: int = DEFAULT_CONNECTIVITY,
    dataset: str | None = None,
    block_voxels: int = _MOST_VOXELS,
    client: Any = None,
) -> BlockComparison:
    """Betti errors and matched parts and cavities of two volumes that need not fit into memory.

    The numbers are those of `compare`, but matched tunnels are not known and nothing is located: for places, compare
    boxes of interest in memory. Each block is read once.

    Args:
        a: what is judged: a file, or an array of zarr, HDF5, Dask, memory maps or in memory.
        b: the truth, on the same grid.
        ignore: value of b at which voxels count as background in both.
        level: as for `from_voxels`; of both.
        label: likewise.
        connectivity: 6 or 26, of both solids.
        dataset: path of the arrays in zarr groups or HDF5 files.
        block_voxels: voxels in a block, at most, but whole chunks of a. Memory is about 40 bytes for each.
        client: a `dask.distributed.Client`, whose workers count the blocks; None for this process.

    Raises:
        InputError: if the grids differ, or a level is needed.
        ReadError, MissingDependencyError: if a volume cannot be opened.

    Example:
        >>> import numpy as np, topokit as tk
        >>> truth = np.zeros((40, 40, 40), dtype=bool)
        >>> truth[4:36, 4:36, 4:36] = True
        >>> truth[10:12, 10:12, 10:12] = False
        >>> prediction = truth.copy()
        >>> prediction[10:12, 10:12] = True
        >>> print(tk.compare_blocks(prediction, truth, block_voxels=8000))
        voxels against voxels: parts 1 matched, 0 missing, 0 spurious; tunnels 0 against 0, not matched in blocks; \
cavities 0 matched, 1 missing, 0 spurious
    """
    first, second = (_blocks(one, dataset, block_voxels, client) for one in (a, b))
    names, shape = (first.volume.name, second.volume.name), first.volume.shape
    if shape != second.volume.shape:
        raise InputError(
            f"{names[0]} has {shape} voxels and {names[1]} {second.volume.shape}: resample one of them to the grid of "
            "the other."
        )
    level, labels = None if level is None else as_number("level", level), as_labels(label)
    check_choice(level, labels)
    solid = Solid(level, labels, check_connectivity(connectivity))
    counting = _Counting(solid, shape, ignore)

    def source(box: Box) -> Any:
        return first.volume.at(box), second.volume.at(box)

    found = reduced(first.division, source, counting.count, _joined, client, _without_faces)
    for seen in found.seen:
        check_mask(solid, seen)
    counted, (common, both) = counted_pair(found.part, shape, connectivity), found.sizes
    matched = counted.matched[0], None, counted.matched[1]
    return BlockComparison(
        names, connectivity, counted.first, counted.second, matched, 2 * common / both if both else 1.0
    )


def _blocks(volume: Any, dataset: str | None, block_voxels: int, client: Any) -> Blocks:
    found = blocks_of(volume, Entry(dataset), block_voxels, client)
    if found is None:
        raise AssertionError("blocks of a size were asked for")
    return found


@dataclass(frozen=True)
class _Counting:
    """The count of blocks of two volumes; it is sent to workers.

    Attributes:
        solid: what is inside.
        shape: of the volumes.
        ignore: value of the second one at which both count as background.
    """

    solid: Solid
    shape: tuple[int, int, int]
    ignore: float | None

    def count(self, sources: Any, box: Box) -> _Found:
        """What is found in a block, of which both values are given, or functions that read them."""
        values = [np.asarray(one() if callable(one) else one) for one in sources]
        if self.ignore is not None:
            values = [np.where(values[1] == self.ignore, one.dtype.type(0), one) for one in values]
        (first, seen), (second, other_seen) = (self.solid.mark(one) for one in values)
        sizes = int((first & second).sum()), int(first.sum()) + int(second.sum())
        part = count_pair(first, second, box, self.shape, self.solid.connectivity)
        return _Found(part, (seen, other_seen), sizes)


def _joined(one: _Found, other: _Found, axis: int) -> _Found:
    seen = one.seen[0].joined(other.seen[0]), one.seen[1].joined(other.seen[1])
    sizes = one.sizes[0] + other.sizes[0], one.sizes[1] + other.sizes[1]
    return _Found(join_pairs(one.part, other.part, axis), seen, sizes)


def _without_faces(found: _Found) -> _Found:
    return found._replace(part=found.part.without_faces())
