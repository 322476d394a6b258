"""Clouds that are never held as a whole: read block by block, here or on a Dask cluster, and reduced on the way."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from topokit.adapters.points.entry import FORMATS
from topokit.adapters.points.invalid_rows import dropped_points, invalid_normals, valid_in_block
from topokit.adapters.points.stored_clouds import Block, Cloud, MappedCloud, StoredCloud
from topokit.core.blocks.on_dask import joined_on_cluster
from topokit.core.cloud.sampling.larger_than_memory import ReducedCloud, reduced
from topokit.core.cloud.sampling.one_point_per_cell import Cells, joined
from topokit.core.cloud.settings import SamplingSettings
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError, ReadError
from topokit.inputs.files import existing_file
from topokit.inputs.formats import stored_in
from topokit.report.wording import plural

MOST_IN_MEMORY = 1 << 24
"""Points up to which a stored cloud is read as a whole."""

MOST_CELLS = SamplingSettings().most_points
"""Cells of which one point is kept."""

MOST_AT_ONCE = 1 << 22
"""Points of a block: some hundred megabytes while it is reduced."""

_LOST = "NaN, infinite or so far off that their squares are"
_WORTH_SAYING = 1e-3  # share of points without others around them; corners of cells hold as many of any surface
_PER_TASK = 4  # blocks that a worker reduces before it hands on what it found


@dataclass(frozen=True)
class Found:
    """What some blocks hold: a summary of their valid points, and how many points there are.

    Attributes:
        cells: the summary.
        n_points: all of them.
        n_lost: points that are not finite, or so large that squares are not.
        n_unclear: other points with normals that are zero or not finite.
    """

    cells: Cells
    n_points: int
    n_lost: int
    n_unclear: int


def stored_cloud(source: object, block_points: int | None, client: Any) -> StoredCloud | None:
    """A cloud that is large, or is to be read block by block; else None. Arguments are those of `from_points`.

    Raises:
        ReadError, MissingDependencyError: if it cannot be opened.
        InputError: if it cannot be read block by block, though that is wanted.
    """
    if block_points is not None and block_points < 1:
        raise InputError(f"block_points must be at least 1, not {block_points}.")
    is_wanted = block_points is not None or client is not None
    stored: StoredCloud | None = None
    if isinstance(source, str | os.PathLike):
        path = existing_file(source)
        if is_wanted or path.stat().st_size > MOST_IN_MEMORY:  # a byte for each point: less is small in any format
            stored = stored_in(FORMATS, path)
    elif isinstance(source, np.memmap) and _is_file(source):
        stored = MappedCloud(source)
    if is_wanted and stored is None:
        what = source if isinstance(source, str | os.PathLike) else f"this {type(source).__name__}"
        raise InputError(
            f"{what} can be used only as a whole; block_points and client are for .las, .laz, .parquet, .ply and text "
            "files, .npy files of one array, and memory maps of these."
        )
    return stored if stored is not None and (is_wanted or stored.n_points > MOST_IN_MEMORY) else None


def is_large(source: Path, options: Mapping[str, Any]) -> bool:
    """Whether `from_points` reads a file block by block; see `Adapter.is_large`."""
    return stored_cloud(source, options.get("block_points"), None) is not None


def _is_file(mapped: np.memmap[Any, Any]) -> bool:
    """Whether a memory map is a whole array of a file, not a part of one."""
    is_whole = mapped.base is not None and not isinstance(mapped.base, np.memmap) and mapped.filename is not None
    return is_whole and mapped.flags.forc and mapped.ndim == 2 and mapped.shape[1] >= 3


def reduced_samples(
    cloud: StoredCloud, block_points: int | None, client: Any
) -> tuple[SurfaceSamples, tuple[str, ...]]:
    """Samples of a stored cloud, at most two million, and sentences about what they are.

    They depend on the points of the file alone, not on its blocks, nor on who reads them.

    Raises:
        ReadError: if the file is damaged, or holds no points.
        InputError: if most points are not finite.
    """
    reader = BlockReader(cloud, block_points or MOST_AT_ONCE, MOST_CELLS)
    found = reader.all(client)
    if found.n_points == 0:
        raise ReadError(f"{cloud.path} holds no points.")
    notes = [dropped_points(found.n_lost, found.n_points, _LOST)] if found.n_lost else []
    if found.n_unclear:
        note, are_ignored = invalid_normals(found.n_unclear, found.n_points)
        notes.append(note)
        found = replace(reader, with_normals=False).all(client) if are_ignored else found
    left = reduced(found.cells)
    normals = None if left.normals is None else torch.from_numpy(left.normals)
    return SurfaceSamples(torch.from_numpy(left.points), normals), (*notes, *_sentences(left, found.n_points))


def _sentences(left: ReducedCloud, n_points: int) -> list[str]:
    kept = f"{len(left.points)} of {n_points} points were kept"
    where = f"at most one in each cell of side {left.side:.3g}" if left.side else "one at each position"
    sentences = [f"{kept}, {where}; what is said here is about these."]
    if left.n_stray > _WORTH_SAYING * n_points:
        sentences.append(
            f"{plural(left.n_stray, 'point')} with too few others around them to be a surface were left out."
        )
    return sentences


@dataclass(frozen=True)
class BlockReader:
    """The reading of a cloud, which workers can be sent.

    Attributes:
        cloud: see there.
        most_points: of a block.
        most_cells: that hold points, at most.
        with_normals: whether normals are kept.
    """

    cloud: StoredCloud
    most_points: int
    most_cells: int
    with_normals: bool = True

    def all(self, client: Any) -> Found:
        """What all blocks hold, read here or by the workers of a cluster."""
        blocks = self.cloud.blocks(self.most_points)
        if client is None:
            return self.read(blocks)
        tasks = [blocks[at : at + _PER_TASK] for at in range(0, max(1, len(blocks)), _PER_TASK)]
        return joined_on_cluster(self.read, tasks, self.join, client)

    def read(self, blocks: Sequence[Block]) -> Found:
        """What some blocks hold."""
        found = _summary((np.empty((0, 3)), None))
        for block in blocks:
            for points, normals in self.cloud.read(block, self.most_points):
                found = self.join([found, _summary((points, normals if self.with_normals else None))])
        return found

    def join(self, parts: Sequence[Found]) -> Found:
        """What several parts hold."""
        seen = [part.cells for part in parts if part.n_points] or [parts[0].cells]
        return Found(
            joined(seen, self.most_cells),
            sum(part.n_points for part in parts),
            sum(part.n_lost for part in parts),
            sum(part.n_unclear for part in parts),
        )


def _summary(rows: Cloud) -> Found:
    points, normals = rows
    is_valid, is_clear = valid_in_block(points, normals)
    if not is_clear.all():
        points, normals = points[is_clear], None if normals is None else normals[is_clear]
    n_valid = int(is_valid.sum())
    return Found(Cells.of(points, normals), len(is_valid), len(is_valid) - n_valid, n_valid - int(is_clear.sum()))
