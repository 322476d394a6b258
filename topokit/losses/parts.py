"""A guard for each component of a solid, where each has a topology of its own to reach."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage

from topokit.core.homotopy.nearest_solid import Betti, Change, Values
from topokit.losses.guard import Decisive, Guard


class _Partition(NamedTuple):
    """The grid shared out among components."""

    regions: NDArray[np.int64]  # number of the nearest component, 0 for the largest
    border: NDArray[np.bool_]  # voxels with another region among their 26 neighbours


class PartsGuard:
    """First the whole solid is asked for its number of components and their sum; then each in its own region.

    A region is what lies nearer to its component than to any other. Components are told apart by size, the largest
    first, when their number has become right; then each keeps its place, and the borders between them are kept free.
    Should parts meet all the same, it begins again.
    """

    def __init__(self, parts: tuple[Betti, ...], change: Change, refresh: int) -> None:
        """Args: parts: Betti numbers of each component, largest first; change, refresh: see `Guard`."""
        self._whole = Guard(tuple(np.sum(parts, axis=0).tolist()), change, refresh)
        self._guards = [Guard(part, change, refresh) for part in parts]
        self._partition: _Partition | None = None
        self.found: Decisive | None = None

    def decisive(self, field: Values, margin: float) -> Decisive | None:
        """See `Guard.decisive`."""
        labels, count = ndimage.label(field > 0)
        if count != len(self._guards):
            self._partition = None
        elif self._partition is None:
            self._partition = _partition(labels)
        if self._partition is None:
            self.found = self._whole.decisive(field, margin)
        else:
            self.found = self._by_region(self._partition, field, margin)
        return self.found

    def _by_region(self, partition: _Partition, field: Values, margin: float) -> Decisive | None:
        wall = -np.abs(field[np.isfinite(field)]).max(initial=1.0)
        parts = []
        for number, guard in enumerate(self._guards):
            mine = partition.regions == number
            found = guard.decisive(np.where(mine, field, wall), margin)
            if found is None:
                return None
            inside = torch.from_numpy(mine[tuple(found.voxels.T.numpy())])
            parts.append((found.voxels[inside], found.sides[inside]))
        at_border = torch.from_numpy(np.argwhere(partition.border & (field > -margin) & np.isfinite(field)))
        parts.append((at_border, torch.full((len(at_border),), -1.0, dtype=torch.float64)))
        voxels, sides = zip(*parts, strict=True)
        return Decisive(torch.cat(voxels), torch.cat(sides))


def _partition(labels: NDArray[np.int32]) -> _Partition:
    """Every voxel goes to the component that is nearest."""
    sizes = np.bincount(labels.ravel())[1:]
    rank = np.empty(len(sizes) + 1, dtype=np.int64)
    rank[1 + np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    nearest = ndimage.distance_transform_edt(labels == 0, return_distances=False, return_indices=True)
    regions = rank[labels[tuple(nearest)]]
    highest, lowest = (
        around(regions, size=3, mode="nearest") for around in (ndimage.maximum_filter, ndimage.minimum_filter)
    )
    return _Partition(regions, highest != lowest)
