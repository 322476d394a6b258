"""Labeled volumes: every label as a shape of its own, from one reading of the volume."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cached_property, reduce
from numbers import Integral
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from topokit.adapters.voxels.adapter import Sampling, counted_answer, open_volume, placed, sampled_shape
from topokit.adapters.voxels.chosen_part import Entry
from topokit.adapters.voxels.counting import Solid
from topokit.adapters.voxels.entry import ADDRESSES
from topokit.adapters.voxels.field import VoxelField
from topokit.adapters.voxels.larger_than_memory import blocks_of, label_in_blocks, labels_in_blocks
from topokit.core.blocks.labeled import count_labels
from topokit.core.blocks.whole import CountedVolume
from topokit.core.components import Corner
from topokit.core.draws import check_sample_count, deferred_seed
from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, check_connectivity
from topokit.core.grid.grid import Grid, Spacing
from topokit.core.grid.labels import Box, around, label_boxes, whole_numbers
from topokit.core.grid.placement import Placement
from topokit.core.local.neighborhood_size import given_or_default
from topokit.errors import InputError
from topokit.inputs.calls import options_by_name
from topokit.inputs.remote import takes_addresses
from topokit.report.wording import plural
from topokit.shape import Shape

Labels = Literal["all"] | Sequence[int]


@options_by_name("spacing")
@takes_addresses(ADDRESSES)
def from_labels(
    volume: str | os.PathLike[str] | Tensor | ArrayLike,
    labels: Labels = "all",
    *,
    spacing: float | Spacing | None = None,
    connectivity: int = DEFAULT_CONNECTIVITY,
    origin: Corner = (0.0, 0.0, 0.0),
    n_samples: int = 10_000,
    n_neighbors: int | None = None,
    generator: torch.Generator | None = None,
    dataset: str | None = None,
    axis: int | str | None = None,
    channel: int | None = None,
    block_voxels: int | None = None,
    client: Any = None,
) -> dict[int, Shape]:
    """The solids of a labeled volume, such as a segmentation, by their labels.

    Each shape is that of `from_voxels(volume, label=label)`, but all labels in memory are counted together, in one pass
    over the voxels, when the first report is asked for.

    Args:
        volume: (X, Y, Z) whole numbers, as a tensor, an array or a path; 0 and NaN are background.
        labels: the labels that are wanted, or "all" positive ones: negative labels usually mean "ignore". Where 255
            means that, name the others.
        spacing: as for `from_voxels`.
        connectivity: as for `from_voxels`, of each label by itself.
        origin: as for `from_voxels`.
        n_samples: as for `from_voxels`.
        n_neighbors: as for `from_voxels`.
        generator: as for `from_voxels`; every label has the same seed.
        dataset: as for `from_voxels`.
        axis: as for `from_voxels`.
        channel: as for `from_voxels`.
        block_voxels: as for `from_voxels`; the volume is read once to find the labels, then the box of each.
        client: as for `from_voxels`.

    Returns:
        Shapes by label: in the given order, or ascending for "all".

    Raises:
        ReadError, MissingDependencyError: as for `from_voxels`.
        InputError: as for `from_voxels`; or if values are no whole numbers, a label has no voxel, or there is none.

    Example:
        >>> import numpy as np, topokit as tk
        >>> volume = np.zeros((5, 5, 7), dtype=int)
        >>> volume[1:4, 1:4, 1:6] = 7
        >>> volume[2, 2, 1:6] = 4
        >>> {label: shape.genus() for label, shape in tk.from_labels(volume).items()}
        {4: 0, 7: 1}
    """
    check_connectivity(connectivity)
    check_sample_count(n_samples, given_or_default(n_neighbors))
    sampling = Sampling(n_samples, deferred_seed(generator), None, n_neighbors)
    entry = Entry(dataset, axis, channel)
    if (blocks := blocks_of(volume, entry, block_voxels, client)) is not None:
        name, boxes = blocks.volume.name, labels_in_blocks(blocks)
        place = placed(blocks.volume.placement, spacing, origin)
        return {
            label: label_in_blocks(blocks, label, boxes[label], place, connectivity, n_neighbors)
            for label in _wanted(name, labels, boxes)
        }
    name, values, found, given_type = open_volume(volume, entry)
    boxes, place = label_boxes(values), placed(found, spacing, origin)
    wanted = _wanted(name, labels, boxes)
    counts = _Counts(values, {label: boxes[label] for label in wanted}, connectivity, place, given_type)
    return {label: counts.shape(name, label, sampling) for label in wanted}


class _Counts:
    """Labels of a volume in memory, which are counted together when the first one is asked for."""

    def __init__(
        self, values: Tensor, boxes: dict[int, Box], connectivity: int, placement: Placement, given_type: torch.dtype
    ) -> None:
        self._values, self._boxes, self._connectivity, self._placement = values, boxes, connectivity, placement
        self._given_type = given_type

    def shape(self, name: str, label: int, sampling: Sampling) -> Shape:
        """The shape of one of them."""
        box, solid = self._boxes[label], Solid(None, (label,), self._connectivity)
        grid = self._grid(box)
        field = VoxelField(
            self._values[box], 0.0, (label,), grid, self._connectivity, self._placement, given_type=self._given_type
        )
        return sampled_shape(
            f"{name}, label {label}",
            field,
            lambda: counted_answer(lambda: self._counted[label], field, self._placement),
            sampling,
            solid.notes(frozenset((label,))),
        )

    @cached_property
    def _counted(self) -> dict[int, CountedVolume]:
        box = reduce(around, self._boxes.values())
        values = whole_numbers(self._values[box].detach().cpu().numpy())
        return count_labels(values, np.sort([*self._boxes]), self._connectivity, self._grid(box))

    def _grid(self, box: Box) -> Grid:
        x, y, z = (side.start for side in box)
        return self._placement.grid(self._values[box].shape, (x, y, z))


def _wanted(name: str, labels: Labels, boxes: dict[int, Box]) -> list[int]:
    """The labels to open, each of which has a box."""
    wanted = [label for label in boxes if label > 0] if labels == "all" else labels
    if not boxes or not wanted:
        raise InputError(f"{name} has no label above 0: all its voxels are background, 0, NaN or negative.")
    if labels == "all":
        return [*wanted]
    if isinstance(labels, str) or not all(isinstance(label, Integral) for label in labels):
        raise InputError(f'labels must be "all" or whole numbers, got {labels!r}.')
    if missing := [str(label) for label in labels if label not in boxes]:
        held = f"{plural(len(boxes), 'label')}, from {min(boxes)} to {max(boxes)}"
        raise InputError(f"no voxel has the label {', '.join(missing)}; {name} has {held}.")
    return [int(label) for label in labels]
