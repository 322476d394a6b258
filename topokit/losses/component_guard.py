"""A guard for solids each of whose components has a topology of its own to reach."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage

from topokit.core.homotopy.nearest_solid import Betti, Change, Values
from topokit.losses.guard import DecisiveVoxels, Guard

Regions = NDArray[np.int64]


class ComponentGuard:
    """Guards the number of components of a solid first, then each component in a region of its own.

    Until the number of components is right, one guard asks the whole solid for it and for the sum of the other Betti
    numbers. Then the grid is divided: each voxel belongs to the nearest component. Components are ranked by size, the
    largest first, when the grid is divided; from then on each keeps its rank, and the borders between their regions are
    kept empty. If components merge, all this starts again.

    Attributes:
        decisive: the result of the last `update`.
    """

    def __init__(self, by_component: tuple[Betti, ...], change: Change, search_every: int) -> None:
        """Args: by_component: Betti numbers of each, largest first; change, search_every: see `Guard`."""
        self._whole = Guard(tuple(np.sum(by_component, axis=0).tolist()), change, search_every)
        self._guards = [Guard(betti, change, search_every) for betti in by_component]
        self._regions: Regions | None = None
        self.decisive: DecisiveVoxels | None = None

    def update(self, field: Values, margin: float) -> DecisiveVoxels | None:
        """See `Guard.update`."""
        labels, count = ndimage.label(field > 0)
        if count != len(self._guards):
            self._regions = None
        elif self._regions is None:
            self._regions = _nearest_component(labels)
        if self._regions is None:
            self.decisive = self._whole.update(field, margin)
        else:
            self.decisive = self._update_regions(self._regions, field, margin)
        return self.decisive

    def _update_regions(self, regions: Regions, field: Values, margin: float) -> DecisiveVoxels | None:
        outside = -np.abs(field[np.isfinite(field)]).max(initial=1.0)
        parts = []
        for rank, guard in enumerate(self._guards):
            mine = regions == rank
            found = guard.update(np.where(mine, field, outside), margin)
            if found is None:
                return None
            inside = torch.from_numpy(mine[tuple(found.voxels.T.numpy())])
            parts.append((found.voxels[inside], found.sides[inside]))
        too_near = np.argwhere(_is_border(regions) & (field > -margin) & np.isfinite(field))
        parts.append((torch.from_numpy(too_near), torch.full((len(too_near),), -1.0, dtype=torch.float64)))
        voxels, sides = zip(*parts, strict=True)
        return DecisiveVoxels(torch.cat(voxels), torch.cat(sides))

    def get_state(self) -> dict[str, Any]:
        """See `Guard.get_state`."""
        return {
            "whole": self._whole.get_state(),
            "components": [guard.get_state() for guard in self._guards],
            "regions": None if self._regions is None else torch.from_numpy(self._regions),
            "decisive": self.decisive and tuple(self.decisive),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """See `Guard.set_state`."""
        self._whole.set_state(state["whole"])
        for guard, own in zip(self._guards, state["components"], strict=True):
            guard.set_state(own)
        self._regions = None if state["regions"] is None else state["regions"].cpu().numpy()
        self.decisive = state["decisive"] and DecisiveVoxels(*(part.cpu() for part in state["decisive"]))


def _nearest_component(labels: NDArray[np.int32]) -> Regions:
    """Rank by size of the component that is nearest to each voxel, 0 for the largest component."""
    sizes = np.bincount(labels.ravel())[1:]
    rank = np.empty(len(sizes) + 1, dtype=np.int64)
    rank[1 + np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    nearest = ndimage.distance_transform_edt(labels == 0, return_distances=False, return_indices=True)
    return rank[labels[tuple(nearest)]]


def _is_border(regions: Regions) -> NDArray[np.bool_]:
    """Voxels with another region among their 26 neighbors."""
    highest = ndimage.maximum_filter(regions, size=3, mode="nearest")
    return highest != ndimage.minimum_filter(regions, size=3, mode="nearest")
