"""Shapes of volumes that are counted block by block and never held as a whole."""

from __future__ import annotations

from typing import Any, NamedTuple

from topokit.adapters.voxels.stored import StoredVolume
from topokit.adapters.voxels.stored_files import readable_in_blocks, stored_volume
from topokit.core.blocks.division import MOST_VOXELS, Division
from topokit.core.components import Corner
from topokit.core.grid.grid import Grid, Spacing
from topokit.errors import InputError
from topokit.shape import Shape

MOST_IN_MEMORY = (
    1 << 27
)  # voxels up to which a stored volume is read as a whole: counting takes 20 to 30 bytes for each


class Blocks(NamedTuple):
    """A volume and how to count it: its blocks, and a client of a Dask cluster, or None for this process."""

    volume: StoredVolume
    division: Division
    client: Any


def blocks_of(volume: Any, dataset: str | None, block_voxels: int | None, client: Any) -> Blocks | None:
    """The blocks of a volume that is large, or is to be counted block by block; else None.

    Arguments are those of `from_voxels`.

    Raises:
        ReadError, MissingDependencyError: if the volume cannot be opened.
        InputError: if it cannot be read block by block, though that is wanted; or there is no volume.
    """
    if block_voxels is not None and block_voxels < 1:
        raise InputError(f"block_voxels must be at least 1, not {block_voxels}.")
    is_wanted = block_voxels is not None or client is not None
    stored = stored_volume(volume, dataset)
    if not is_wanted and (stored is None or stored.n_voxels <= MOST_IN_MEMORY):
        return None
    stored = readable_in_blocks(volume) if stored is None else stored
    return Blocks(stored, Division.of(stored.chunks, block_voxels or MOST_VOXELS), client)


def shape_in_blocks(
    blocks: Blocks,
    spacing: Spacing,
    origin: Corner,
    level: float | None,
    label: float | None,
    connectivity: int,
    n_neighbors: int | None,
) -> Shape:
    """The shape of a volume whose report is counted block by block; arguments are those of `from_voxels`."""
    from topokit.adapters.voxels.counting import Solid, answer_in_blocks  # imports numba

    volume, grid = blocks.volume, Grid(blocks.volume.shape, spacing, origin)

    def refuse() -> Any:
        raise InputError(
            f"{volume.name} is counted block by block, so it has a report, but no samples and no surface. Open a "
            "part of it in memory: from_voxels(volume[:256, :256, :256])."
        )

    return Shape(
        refuse,
        lambda: answer_in_blocks(volume, blocks.division, Solid(level, label, connectivity), grid, blocks.client),
        surface=refuse,
        name=volume.name,
        notes=() if label is None else (f"The solid is the voxels with label {label}.",),
        n_neighbors=n_neighbors,
    )
