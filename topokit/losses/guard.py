"""The guard: finds the voxels that decide a field's topology, and the side of the level on which each has to be.

It works with the nearest solid of the wanted topology. A voxel that is simple in this solid may be inside or outside
without consequence; every other voxel decides the topology, and the field has to be on the solid's side there, by a
margin. So all voxels of a surplus part are pushed at once, and so is the whole row of a missing bridge, where a
critical point would be one voxel at a time; and what is right already is held.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from topokit.core.arrays import Booleans
from topokit.core.grid.betti import betti_numbers
from topokit.core.homotopy.deformation import deform
from topokit.core.homotopy.nearest_solid import Betti, Change, Values, cost, nearest_solid
from topokit.core.homotopy.simple_points import PaddedSolid, is_simple
from topokit.core.labels import inverse_order
from topokit.losses.goal import Goal

Regions = NDArray[np.int64]
Memory = dict[str, Any]
"""What is known of one field from earlier calls: tensors, numbers and such dictionaries, so that it can be saved."""

_SWITCH_BELOW = 0.5  # a newly found solid replaces the known one below this share of its cost


class DecisiveVoxels(NamedTuple):
    """Voxels that must be on a given side of the level and are not, or not by the margin.

    Attributes:
        voxels: (M, 3) int64 grid indices (x, y, z).
        sides: (M,) float64, +1 where the field must be above the level, -1 where below.
    """

    voxels: Tensor
    sides: Tensor


@dataclass(frozen=True)
class Guard:
    """Finds decisive voxels.

    Attributes:
        change: whether voxels may be added, removed or both; see `nearest_solid`.
        search_every: of a field that is remembered, searches for a nearer solid take place in every so many updates.
            In between, the known solid follows the field.
    """

    change: Change = "any"
    search_every: int = 20

    def update(self, field: Values, goal: Goal, margin: float, memory: Memory) -> DecisiveVoxels | None:
        """The decisive voxels of a field, or None if no solid of the wanted topology is in reach.

        Args:
            field: (X, Y, Z), level subtracted, positive inside, not NaN; infinite values cannot be moved.
            goal: the wanted topology.
            margin: distance from the level, in units of the field, that decisive voxels must have.
            memory: what earlier updates of the same field have left; empty for a field that is not known.
        """
        movable = np.isfinite(field)
        if not movable.all():
            largest = np.abs(field[movable]).max(initial=0.0) or 1.0
            field = np.where(movable, field, np.where(field > 0, largest, -largest))
        if goal.by_component:
            return self._by_component(field, movable, goal.by_component, margin, memory)
        return self._whole(field, movable, goal, margin, memory)

    def _whole(
        self, field: Values, movable: Booleans, goal: Goal, margin: float, memory: Memory
    ) -> DecisiveVoxels | None:
        present = field > 0
        if goal.target is not None:
            solid: Booleans | None = deform(goal.target, present)
        else:
            solid = self._nearest(field, present, _wanted(goal, present), memory)
        return None if solid is None else _decisive_voxels(solid, field, movable, margin)

    def _nearest(self, field: Values, present: Booleans, betti: Betti, memory: Memory) -> Booleans | None:
        """The solid that has followed the field, or a nearer one that is found if it is time to search."""
        known = memory.get("solid")
        solid = None if known is None else deform(known.cpu().numpy(), present)
        n_updates = memory.get("n_updates", 0)
        if n_updates % self.search_every == 0 and not (solid is not None and np.array_equal(solid, present)):
            found = nearest_solid(field, betti, self.change)
            if found is not None and (solid is None or cost(field, found) < _SWITCH_BELOW * cost(field, solid)):
                solid = found
        memory["n_updates"] = n_updates + 1
        memory["solid"] = None if solid is None else torch.from_numpy(solid)
        return solid

    def _by_component(
        self, field: Values, movable: Booleans, wanted: tuple[Betti, ...], margin: float, memory: Memory
    ) -> DecisiveVoxels | None:
        """Guards the number of components first, then each component in a region of its own.

        Until the number of components is right, the whole solid is asked for it and for the sums of the other Betti
        numbers. Then the grid is divided: each voxel belongs to the nearest component. Components are ranked by size,
        the largest first, when the grid is divided; in a field that is remembered each keeps its rank from then on, and
        the borders between their regions are kept empty. If components merge, all this starts again.
        """
        labels, count = ndimage.label(field > 0)
        if count != len(wanted):
            memory.pop("regions", None)
            betti: Betti = tuple(np.sum(wanted, axis=0).tolist())
            return self._whole(field, movable, Goal(betti), margin, memory)
        if memory.get("regions") is None:
            memory["regions"] = torch.from_numpy(_nearest_component(labels))
            memory["parts"] = [{} for _ in wanted]
        regions = memory["regions"].cpu().numpy()
        outside = -np.abs(field).max(initial=1.0)
        parts = []
        for rank, (betti, own) in enumerate(zip(wanted, memory["parts"], strict=True)):
            mine = regions == rank
            found = self._whole(np.where(mine, field, outside), movable, Goal(betti), margin, own)
            if found is None:
                return None
            inside = torch.from_numpy(mine[tuple(found.voxels.T.numpy())])
            parts.append((found.voxels[inside], found.sides[inside]))
        too_near = np.argwhere(_is_border(regions) & (field > -margin) & movable)
        parts.append((torch.from_numpy(too_near), torch.full((len(too_near),), -1.0, dtype=torch.float64)))
        voxels, sides = zip(*parts, strict=True)
        return DecisiveVoxels(torch.cat(voxels), torch.cat(sides))


def _wanted(goal: Goal, present: Booleans) -> Betti:
    """The Betti numbers of a goal; of one with limits, those that the solid has, as far as the limits allow."""
    if not goal.at_most:
        return goal.betti
    own = betti_numbers(present).tolist()
    components, tunnels, cavities = (min(have, most) for have, most in zip(own, goal.betti, strict=True))
    return components, tunnels, cavities


def _nearest_component(labels: NDArray[np.int32]) -> Regions:
    """Rank by size of the component that is nearest to each voxel, 0 for the largest component."""
    sizes = np.bincount(labels.ravel())[1:]
    rank = inverse_order(np.argsort(-sizes, kind="stable"))
    nearest = ndimage.distance_transform_edt(labels == 0, return_distances=False, return_indices=True)
    return rank[labels[tuple(nearest)] - 1]


def _is_border(regions: Regions) -> Booleans:
    """Voxels with another region among their 26 neighbors."""
    highest = ndimage.maximum_filter(regions, size=3, mode="nearest")
    return highest != ndimage.minimum_filter(regions, size=3, mode="nearest")


def _decisive_voxels(solid: Booleans, field: Values, movable: Booleans, margin: float) -> DecisiveVoxels:
    """Voxels short of the margin on the solid's side that are not simple in the solid."""
    short = movable & (np.where(solid, field, -field) < margin)
    padded = PaddedSolid(solid)
    voxels = np.argwhere(short)[~is_simple(padded.codes(padded.indices(short)))]
    sides = np.where(solid[tuple(voxels.T)], 1.0, -1.0)
    return DecisiveVoxels(torch.from_numpy(voxels), torch.from_numpy(sides))
