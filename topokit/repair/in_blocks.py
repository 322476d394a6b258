"""Volumes that are mended block by block: each with what is around it, and only what it settles by itself."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from topokit.adapters.voxels.copy_in_blocks import StoredCopy, stored_copy
from topokit.adapters.voxels.field import VoxelField
from topokit.adapters.voxels.larger_than_memory import StoredSolid, shape_in_blocks
from topokit.adapters.voxels.opening_stored import stored_volume
from topokit.core.arrays import Floats, Integers
from topokit.core.blocks.division import Box, Division
from topokit.core.grid.euler import comparable
from topokit.core.grid.grid import Grid
from topokit.core.homotopy.simplified import Block, Way
from topokit.core.progress import advance, begin, stages
from topokit.core.removal import Removal
from topokit.errors import InputError
from topokit.repair.volumes import (
    counted_simplification,
    removals_of,
    simplified_field,
    with_values_of_the_nearest,
)
from topokit.report.counted import CountedAnswer
from topokit.report.progress import progress_bar
from topokit.report.simplification import Unsettled
from topokit.shape import Shape

_OVERLAP = 32  # voxels around a block, at least, that are looked at to see what its narrow places are
_WIDTHS = 4  # and at least so many widths
_STAGE = "narrow features"


def simplified_in_blocks(
    shape: Shape, stored: StoredSolid, below: float, ways: frozenset[Way], out: str | os.PathLike[str]
) -> Shape:
    """A volume without its narrow features, as far as blocks show what these are, in a new file; see `Shape.simplify`.

    Raises:
        InputError: if it is periodic or cut out of a larger body, all of it is narrower, or `out` cannot be written.
    """
    volume = stored.blocks.volume
    if stored.ends.is_periodic or stored.ends.edges == "cut-out":
        raise InputError(f"{shape.name} is periodic or cut out of a larger body: open it without that to change it.")
    before = shape.report().solid_betti
    if before is None:
        raise AssertionError(f"{shape.name}: a volume has no Betti numbers")
    steps = stored.grid.spacing
    around = [max(_OVERLAP, _WIDTHS * int(np.ceil(below / step))) for step in steps]
    removals, unsettled, changed = list[Removal](), list[Unsettled](), np.empty(0, dtype=np.int64)
    narrowest = np.inf
    with stored_copy(out, volume) as copy:
        with progress_bar([shape.name]), stages({_STAGE: 1.0}):
            begin(_STAGE)
            cores = Division.even(volume.shape, stored.blocks.most_voxels).boxes
            for number, core in enumerate(cores):
                more, left, flipped, wider = _mended(copy, stored, core, around, below, ways)
                removals, unsettled, narrowest = removals + more, unsettled + left, min(narrowest, wider)
                changed = np.setxor1d(changed, np.ravel_multi_index(tuple(flipped.T), volume.shape))
                advance((number + 1) / len(cores))
        counted = _shape_of(shape, stored, copy.path)
        after = counted.report().solid_betti
        done = counted_simplification(shape.name, below, removals, before, after, len(changed), narrowest, unsettled)
    made = _shape_of(shape, stored, Path(out), counted.counted)
    return made.replace(simplification=done, notes=(*shape.notes, done.summary()))


def _shape_of(shape: Shape, stored: StoredSolid, path: Path, answer: CountedAnswer | None = None) -> Shape:
    """The shape of a copy of a volume, with its answer if that has been counted already."""
    copied = stored_volume(path)
    if copied is None:
        raise AssertionError(f"{path} cannot be read in blocks")
    copied.name = shape.name
    blocks = stored.blocks._replace(volume=copied, division=Division.of(copied.chunks, stored.blocks.most_voxels))
    placed = stored.placement, stored.grid, stored.solid
    return shape_in_blocks(blocks, *placed, shape.n_neighbors, stored.ends, answer)


def _mended(
    copy: StoredCopy, stored: StoredSolid, core: Box, around: list[int], below: float, ways: frozenset[Way]
) -> tuple[list[Removal], list[Unsettled], Integers, float]:
    """Mend the core of a block in a copy.

    Returns:
        What was removed, what is not settled, the voxels (N, 3) that changed, and `Simplified.narrowest`.
    """
    shape, spacing = stored.blocks.volume.shape, stored.grid.spacing
    x, y, z = ((max(a - more, 0), min(b + more, n)) for (a, b), more, n in zip(core, around, shape, strict=True))
    low = np.array([a for a, _ in (x, y, z)])
    values = copy.read((x, y, z))
    origin = np.asarray(stored.grid.origin) + low * spacing
    field = _field_of(values, stored, origin)
    inside = field.is_inside(field.volume).numpy()
    if inside.all() or not inside.any():
        return [], [], np.empty((0, 3), dtype=np.int64), np.inf
    ends_x, ends_y, ends_z = ((a > 0, b < n) for (a, b), n in zip((x, y, z), shape, strict=True))
    core_x, core_y, core_z = ((a - first, b - first) for (a, b), first in zip(core, low.tolist(), strict=True))
    block = Block((ends_x, ends_y, ends_z), (core_x, core_y, core_z))
    whole = tuple(slice(0, n) for n in inside.shape)
    found = simplified_field(field, inside, whole, below, ways, block)
    changed = found.changed
    if len(changed):
        new = with_values_of_the_nearest(values, inside, changed)
        first, last = changed.min(axis=0), changed.max(axis=0) + 1
        a, b, c = zip((low + first).tolist(), (low + last).tolist(), strict=True)
        copy.write((a, b, c), new[tuple(map(slice, first, last))])
    left = []
    for (kind, _), one in found.unsettled:
        px, py, pz = (origin + one.voxel * spacing).tolist()
        left.append(Unsettled(kind, one.width, (px, py, pz)))
    return removals_of(found.steps, origin, spacing), left, changed + low, found.narrowest


def _field_of(values: NDArray[Any], stored: StoredSolid, origin: Floats) -> VoxelField:
    """The field of a block; without a level or labels that of a binary volume, whatever its higher value."""
    level, labels, connectivity = stored.solid.level, stored.solid.labels, stored.solid.connectivity
    x, y, z = origin.tolist()
    a, b, c = values.shape
    grid = Grid((a, b, c), stored.grid.spacing, (x, y, z))
    volume = comparable(torch.from_numpy(values > 0 if level is None and not labels else values))
    return VoxelField(volume, level or 0.0, labels, grid, connectivity)
