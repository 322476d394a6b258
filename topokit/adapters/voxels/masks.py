"""Volumes as masks: which voxels are inside, also where none is."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from torch import Tensor

from topokit.adapters.voxels.adapter import as_labels, as_number, check_choice, open_volume, placed
from topokit.adapters.voxels.chosen_part import Entry
from topokit.adapters.voxels.counting import Seen, Solid
from topokit.core.arrays import Booleans
from topokit.core.grid.grid import Grid, Spacing
from topokit.core.grid.placement import Placement


class OpenedVolume(NamedTuple):
    """A volume in memory.

    Attributes:
        name: what to call it.
        values: (X, Y, Z).
        placement: where its voxels are.
    """

    name: str
    values: Tensor
    placement: Placement

    @property
    def grid(self) -> Grid:
        """The centers of the voxels, in the coordinates of the shape."""
        return self.placement.grid(self.values.shape)


def opened_volume(
    volume: str | os.PathLike[str] | Tensor | ArrayLike,
    spacing: float | Spacing | None = None,
    dataset: str | None = None,
) -> OpenedVolume:
    """The values of a volume, whose arguments and errors are those of `from_voxels`."""
    name, values, found, _ = open_volume(volume, Entry(dataset))
    return OpenedVolume(name, values.detach().cpu(), placed(found, spacing, (0.0, 0.0, 0.0)))


def mask_of(values: Tensor, level: float | None, label: float | tuple[float, ...] | None) -> Booleans:
    """Which voxels (X, Y, Z) are inside, by level or label as for `from_voxels`; there may be none.

    Raises:
        InputError: if both are given, or neither and the volume is not binary.
    """
    level, labels = None if level is None else as_number("level", level), as_labels(label)
    check_choice(level, labels)
    solid = Solid(level, labels, 6)
    inside, seen = solid.mark(np.asarray(values))
    check_mask(solid, seen)
    return inside


def check_mask(solid: Solid, seen: Seen) -> None:
    """Raise the errors of a volume's values, of which none needs to be inside; see `Solid.check`."""
    must_be_binary = solid.level is None and not solid.labels
    if not seen.is_empty or (must_be_binary and not seen.is_binary):
        solid.check(seen)
