"""Counting a volume block by block, in this process or on the workers of a Dask cluster."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from topokit.adapters.voxels.field import SLAB, Labels, listed
from topokit.adapters.voxels.periodic_or_cut_out import Ends, cut_out_answer, periodic_answer
from topokit.adapters.voxels.stored_volumes import StoredVolume
from topokit.core.blocks.cube_parts import CubePart, count_cube_part, join_cube_parts
from topokit.core.blocks.division import Box, Division, Triple
from topokit.core.blocks.on_dask import reduced
from topokit.core.blocks.part import Part, count_box, join_parts
from topokit.core.blocks.periodic import periodic_solid
from topokit.core.blocks.whole import counted_volume
from topokit.core.grid.grid import Grid
from topokit.core.grid.placement import Placement
from topokit.errors import InputError, Option
from topokit.report.counted import CountedAnswer
from topokit.report.volume import volume_answer
from topokit.report.wording import plural


class Seen(NamedTuple):
    """The values of a block.

    Attributes:
        low, high: of all that are not NaN; of a block with voxels inside only if they decide what is inside.
        n_nan: number of NaN.
        is_binary: whether all others are 0 or `high`.
        is_empty: whether no voxel is inside.
        labels: those that were looked for and found.
    """

    low: float
    high: float
    n_nan: int
    is_binary: bool
    is_empty: bool
    labels: frozenset[float] = frozenset()

    def joined(self, other: Seen) -> Seen:
        """Those of two blocks."""
        highs = {one.high for one in (self, other) if one.high > 0}
        return Seen(
            min(self.low, other.low),
            max(self.high, other.high),
            self.n_nan + other.n_nan,
            self.is_binary and other.is_binary and len(highs) <= 1,
            self.is_empty and other.is_empty,
            self.labels | other.labels,
        )


class Found(NamedTuple):
    """What was found in a box; the cubes only where the ends of the volume are no ends."""

    part: Part
    seen: Seen
    cubes: CubePart | None = None


@dataclass(frozen=True)
class Solid:
    """What is inside, and how it is connected.

    Attributes:
        level: voxels above it are inside; None if the values must be those of a binary volume.
        labels: voxels equal to one of them are inside, if there are any.
        connectivity: 6 or 26.
    """

    level: float | None
    labels: Labels
    connectivity: int

    def mark(self, values: NDArray[Any]) -> tuple[NDArray[np.bool_], Seen]:
        """Which voxels of a block are inside, and what its values are."""
        if not self.labels:
            inside = values > (self.level or 0)
            return inside, self._seen(values, is_empty=not inside.any())
        present, inside = set(), np.zeros(values.shape, bool)
        for label in self.labels:
            has_label = values == label
            if has_label.any():
                present.add(label)
                inside |= has_label
        return inside, self._seen(values, is_empty=not present)._replace(labels=frozenset(present))

    def seen(self, values: Tensor) -> Seen:
        """What the values of a volume in memory are; handles a few layers at a time."""
        parts = (part.float() if part.dtype == torch.bfloat16 else part for part in values.detach().split(SLAB))
        return reduce(Seen.joined, (self.mark(part.cpu().numpy())[1] for part in parts))

    def _seen(self, values: NDArray[Any], is_empty: bool) -> Seen:
        n_nan = int(np.isnan(values).sum()) if values.dtype.kind == "f" else 0
        must_be_binary = self.level is None and not self.labels and values.dtype != bool
        if n_nan == values.size or not (must_be_binary or is_empty):
            return Seen(np.inf, -np.inf, n_nan, True, is_empty)
        known = values[~np.isnan(values)] if n_nan else values
        low, high = known.min(), known.max()
        is_binary = must_be_binary and bool(((known == 0) | (known == high)).all())
        return Seen(float(low), float(high), n_nan, is_binary or values.dtype == bool, is_empty)

    def check(self, seen: Seen) -> tuple[str, ...]:
        """Sentences for the report about the values of the whole volume.

        Raises:
            InputError: if they are not what they were taken for, or nothing is inside.
        """
        if seen.low > seen.high and seen.is_empty:
            raise InputError("all voxels are NaN.")
        if self.level is None and not self.labels and not (seen.is_binary and seen.low >= 0):
            middle = f" (inside is above it; {(seen.low + seen.high) / 2:g} would be half-way)"
            raise InputError(
                f"the volume has more than the two values of a binary one, from {seen.low:g} to {seen.high:g}: pass ",
                *(Option("level", "…"), middle, " or, for a labeled volume, ", Option("label", "…")),
                " (all labels: topokit.from_labels, --labels all).",
            )
        if seen.is_empty:
            above = f"is above the level {self.level or 0:g}"
            wanted = f"equals the label {listed(self.labels)}" if self.labels else above
            raise InputError(f"no voxel {wanted}: the volume's values go from {seen.low:g} to {seen.high:g}.")
        if self.labels:
            return self.notes(seen.labels)
        return (f"NaN counts as background, in {plural(seen.n_nan, 'voxel')}.",) if seen.n_nan else ()

    def notes(self, found: frozenset[float]) -> tuple[str, ...]:
        """Sentences about the labels, of which some were found."""
        absent = tuple(label for label in self.labels if label not in found)
        lacking = (f"No voxel has the label {listed(absent)}.",) if absent else ()
        return (f"The solid is the voxels with label {listed(self.labels)}.", *lacking)


@dataclass(frozen=True)
class BlockCount:
    """The count of blocks of a volume; it is sent to workers.

    Attributes:
        solid: what is inside.
        shape: of the volume.
        ends: what there is beyond.
    """

    solid: Solid
    shape: Triple
    ends: Ends

    def count(self, source: Any, block: Box) -> Found:
        """What is found in a block.

        Args:
            source: its values, or a function that reads them.
            block: where it is in the volume.
        """
        inside, seen = self.solid.mark(values_of(source))
        periodic, is_cut_out = self.ends.periodic, self.ends.edges == "cut-out"
        part = count_box(inside, block, self.shape, self.solid.connectivity, periodic)
        if not is_cut_out and not self.ends.is_periodic:
            return Found(part, seen)
        has_layer = [not wraps and not is_cut_out for wraps in periodic]
        return Found(part, seen, count_cube_part(inside, block, self.shape, has_layer))


def values_of(source: Any) -> NDArray[Any]:
    """The values of a block, given these or a function that reads them."""
    return np.asarray(source() if callable(source) else source)


def joined(one: Found, other: Found, axis: int) -> Found:
    """What was found in two boxes side by side."""
    cubes = None if one.cubes is None or other.cubes is None else join_cube_parts(one.cubes, other.cubes, axis)
    return Found(join_parts(one.part, other.part, axis), one.seen.joined(other.seen), cubes)


def answer_in_blocks(
    volume: StoredVolume,
    division: Division,
    solid: Solid,
    grid: Grid,
    placement: Placement,
    client: Any,
    ends: Ends,
) -> CountedAnswer:
    """The counted answer of a volume.

    Args:
        volume: where its values are; that of a periodic one is longer, see `LongerVolume`.
        division: its blocks, each of which is read once.
        solid: what is inside.
        grid: of the volume.
        placement: of the whole volume that this one may be a box of.
        client: of a Dask cluster, or None for this process, one block after the other.
        ends: what there is at the ends of the volume.

    Raises:
        InputError: if no voxel is inside, or a level is needed.
    """
    started = time.perf_counter()
    count = BlockCount(solid, volume.shape, ends).count
    found = reduced(division, volume.at, count, joined, client, _keep if ends.is_periodic else without_faces)
    notes, connectivity = solid.check(found.seen), solid.connectivity
    if ends.is_periodic and found.cubes is not None:
        torus = periodic_solid(found.part, found.cubes.counts, connectivity, ends.periodic)
        return periodic_answer(torus, connectivity, ends.periodic, placement, time.perf_counter() - started, notes)
    counted = counted_volume(found.part, connectivity, grid)
    answer = volume_answer(counted, connectivity, placement, time.perf_counter() - started, notes)
    return answer if found.cubes is None else cut_out_answer(answer, found.cubes.counts, connectivity, grid)


def without_faces(found: Found) -> Found:
    """What was found in a whole volume, without what only joining needs."""
    return found._replace(part=found.part.without_faces())


def _keep(found: Found) -> Found:
    """What was found in a periodic volume: its faces are still to be joined."""
    return found
