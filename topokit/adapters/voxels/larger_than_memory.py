"""Shapes of volumes that are counted block by block and never held as a whole."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from topokit.adapters.voxels.chosen_part import Entry
from topokit.adapters.voxels.counting import Solid, answer_in_blocks, values_of
from topokit.adapters.voxels.curve_in_blocks import curve_in_blocks
from topokit.adapters.voxels.opening_stored import readable_in_blocks, stored_volume
from topokit.adapters.voxels.periodic_or_cut_out import Ends, periodic_shape
from topokit.adapters.voxels.stored_volumes import DaskVolume, LongerVolume, PartOfVolume, StoredVolume
from topokit.core.blocks.division import MOST_VOXELS, Box, Division
from topokit.core.blocks.on_dask import active_client, reduced
from topokit.core.grid.grid import Grid
from topokit.core.grid.labels import Box as LabelBox
from topokit.core.grid.labels import joined_boxes, tight_boxes, widened
from topokit.core.grid.placement import Placement
from topokit.errors import InputError, NoSamplesError
from topokit.inputs.files import user_path
from topokit.inputs.remote import is_address
from topokit.inputs.unpacking import is_temporary
from topokit.report.counted import CountedAnswer
from topokit.shape import Shape

MOST_IN_MEMORY = 1 << 27  # voxels up to which a stored volume is read as a whole: at most 1 GiB of float64


class Blocks(NamedTuple):
    """A volume and how to count it: its blocks, how large they are, and a client of a Dask cluster, or None."""

    volume: StoredVolume
    division: Division
    most_voxels: int
    client: Any


class StoredSolid(NamedTuple):
    """A solid that is counted block by block: its volume, where that is, what is inside, and what is beyond."""

    blocks: Blocks
    placement: Placement
    grid: Grid
    solid: Solid
    ends: Ends


def blocks_of(volume: Any, entry: Entry, block_voxels: int | None, client: Any) -> Blocks | None:
    """The blocks of a volume that is large, or is to be counted block by block; else None.

    Arguments are those of `from_voxels`.

    Raises:
        ReadError, MissingDependencyError: if the volume cannot be opened.
        InputError: if it cannot be read block by block, though that is wanted; or there is no volume.
    """
    if block_voxels is not None and block_voxels < 1:
        raise InputError(f"block_voxels must be at least 1, not {block_voxels}.")
    is_wanted = block_voxels is not None or client is not None
    stored = stored_volume(volume, entry)
    if not is_wanted and (stored is None or stored.n_voxels <= MOST_IN_MEMORY):
        return None
    if isinstance(volume, str | os.PathLike) and not is_address(volume) and is_temporary(user_path(volume)):
        raise InputError(
            f"{Path(volume).name} is to be counted block by block, but its file is only a copy while it is opened: "
            "pass the path of a file on disk, or the address of a zarr volume."
        )
    stored = readable_in_blocks(volume, entry) if stored is None else stored
    if client is None and isinstance(stored, DaskVolume):
        client = active_client()
    most_voxels = block_voxels or MOST_VOXELS
    return Blocks(stored, Division.of(stored.chunks, most_voxels), most_voxels, client)


def is_large(source: Path | str, options: Mapping[str, Any]) -> bool:
    """Whether `from_voxels` counts a file block by block; see `Adapter.is_large`."""
    entry = Entry(*(options.get(name) for name in Entry._fields))
    return blocks_of(source, entry, options.get("block_voxels"), None) is not None


def labels_in_blocks(blocks: Blocks) -> dict[int, LabelBox]:
    """The box of every label of a volume, as `label_boxes` finds it in memory."""
    volume = blocks.volume
    found = reduced(blocks.division, volume.at, _boxes_in_block, _joined_boxes, blocks.client, dict)
    return {label: widened(box, volume.shape) for label, box in sorted(found.items())}


def label_in_blocks(
    blocks: Blocks,
    label: int,
    box: LabelBox,
    placement: Placement,
    connectivity: int,
    n_neighbors: int | None,
) -> Shape:
    """The shape of a label, counted in the blocks of its box; other arguments are those of `from_labels`."""
    x, y, z = ((side.start, side.stop) for side in box)
    part = PartOfVolume(blocks.volume, (x, y, z), f"{blocks.volume.name}, label {label}")
    own = Blocks(part, Division.of(part.chunks, blocks.most_voxels), blocks.most_voxels, blocks.client)
    grid = placement.grid(part.shape, (x[0], y[0], z[0]))
    return shape_in_blocks(own, placement, grid, Solid(None, (label,), connectivity), n_neighbors)


def _boxes_in_block(source: Any, block: Box) -> dict[int, LabelBox]:
    first = [start for start, _ in block]
    found = {}
    for label, box in tight_boxes(values_of(source)).items():
        x, y, z = (slice(side.start + start, side.stop + start) for side, start in zip(box, first, strict=True))
        found[label] = x, y, z
    return found


def _joined_boxes(one: dict[int, LabelBox], other: dict[int, LabelBox], axis: int) -> dict[int, LabelBox]:
    return joined_boxes(one, other)


def shape_in_blocks(
    blocks: Blocks,
    placement: Placement,
    grid: Grid,
    solid: Solid,
    n_neighbors: int | None,
    ends: Ends | None = None,
    answer: CountedAnswer | None = None,
) -> Shape:
    """The shape of a volume whose report is counted block by block.

    Args:
        blocks: the volume.
        placement: of the file's whole volume.
        grid: of this one, which may be a box of that.
        solid: what is inside.
        n_neighbors: as for `from_voxels`.
        ends: what there is at the ends of the volume; background if None.
        answer: if it has been counted already.
    """
    volume, ends = blocks.volume, ends or Ends()
    stored = StoredSolid(blocks, placement, grid, solid, ends)

    def refuse() -> Any:
        raise NoSamplesError(
            f"{volume.name} is counted block by block, so it has a report and a curve, but no samples and no surface. "
            "Open a part of it in memory: from_voxels(volume[:256, :256, :256])."
        )

    if ends.is_periodic:
        longer = LongerVolume(volume, ends.periodic)
        division = Division.of(longer.chunks, blocks.most_voxels)
        return periodic_shape(
            volume.name, lambda: answer_in_blocks(longer, division, solid, grid, placement, blocks.client, ends)
        )
    return Shape(
        refuse,
        answer or (lambda: answer_in_blocks(volume, blocks.division, solid, grid, placement, blocks.client, ends)),
        surface=refuse,
        stored=stored,
        curve=lambda levels: curve_in_blocks(volume, blocks.division, solid, blocks.client, levels),
        name=volume.name,
        n_neighbors=n_neighbors,
    )
