"""The guard: finds the voxels that decide a field's topology, and the side of the level on which each has to be.

The guard keeps the nearest solid of the wanted topology. A voxel that is simple in this solid may be inside or outside
without consequence; every other voxel decides the topology, and the field has to be on the solid's side there, by a
margin. So all voxels of a surplus part are pushed at once, and so is the whole row of a missing bridge, where a
critical point would be one voxel at a time; and what is right already is held.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from topokit.core.arrays import Booleans
from topokit.core.grid.euler import at_least_single
from topokit.core.grid.field import Field, median_step_at_crossings
from topokit.core.homotopy.deformation import deform
from topokit.core.homotopy.nearest_solid import Betti, Change, Values, cost, nearest_solid
from topokit.core.homotopy.simple_points import PaddedSolid, is_simple
from topokit.losses.memory import Memory

Regions = NDArray[np.int64]

_SWITCH_BELOW = 0.5  # a newly found solid replaces the known one below this share of its cost


class DecisiveVoxels(NamedTuple):
    """Voxels that must be on a given side of the level and are not, or not by the margin.

    Attributes:
        voxels: (M, 3) int64 grid indices (x, y, z).
        sides: (M,) float64, +1 where the field must be above the level, -1 where below.
    """

    voxels: Tensor
    sides: Tensor


class Guard(Memory):
    """Tracks the nearest solid of a wanted topology for one field that changes slowly, as in a training loop.

    Attributes:
        solid: (X, Y, Z) bool, or None until one is found.
    """

    remembers = ("_solid", "_n_updates", "_cell_change")

    def __init__(self, betti: Betti, change: Change, search_every: int) -> None:
        """Args: betti: components, tunnels, cavities; change: see `nearest_solid`; search_every: in updates."""
        self.betti = betti
        self.change = change
        self.search_every = search_every
        self._solid: Tensor | None = None
        self._n_updates = 0
        self._cell_change = float("inf")  # the field's typical change over one cell

    @property
    def solid(self) -> Booleans | None:
        """See the class."""
        return None if self._solid is None else self._solid.cpu().numpy()

    def update(self, field: Values, margin: float) -> DecisiveVoxels | None:
        """The decisive voxels of a field, or None if no solid of the wanted topology is in reach.

        Args:
            field: (X, Y, Z), level subtracted, positive inside. NaN is background; infinite values cannot be moved.
            margin: distance from the level, in units of the field, that decisive voxels must have. It is limited by the
                field's typical change over one cell: beyond it all voxels well inside and outside would be decisive.
        """
        movable = np.isfinite(field)
        if not movable.all():
            largest = np.abs(field[movable]).max(initial=0.0) or 1.0
            field = np.where(movable, field, np.where(field > 0, largest, -largest))
        solid = self._updated_solid(field)
        if solid is None:
            return None
        self._solid = torch.from_numpy(solid)
        return _decisive_voxels(solid, field, movable, min(margin, self._cell_change))

    def _updated_solid(self, field: Values) -> Booleans | None:
        """The solid that has followed the field, or a nearer one that is found if it is time to search."""
        present = field > 0
        solid = None if self.solid is None else deform(self.solid, present)
        is_due = self._n_updates % self.search_every == 0
        self._n_updates += 1
        if is_due and present.any() and not present.all():
            self._cell_change = median_step_at_crossings(torch.from_numpy(field)) or float("inf")
        if not is_due or (solid is not None and np.array_equal(solid, present)):
            return solid
        found = nearest_solid(field, self.betti, self.change)
        if found is not None and (solid is None or cost(field, found) < _SWITCH_BELOW * cost(field, solid)):
            return found
        return solid


class ComponentGuard(Memory):
    """Guards the number of components of a solid first, then each component in a region of its own.

    Until the number of components is right, one guard asks the whole solid for it and for the sum of the other Betti
    numbers. Then the grid is divided: each voxel belongs to the nearest component. Components are ranked by size, the
    largest first, when the grid is divided; from then on each keeps its rank, and the borders between their regions are
    kept empty. If components merge, all this starts again.
    """

    remembers = ("_whole", "_guards", "_regions")

    def __init__(self, by_component: tuple[Betti, ...], change: Change, search_every: int) -> None:
        """Args: by_component: Betti numbers of each, largest first; change, search_every: see `Guard`."""
        self._whole = Guard(tuple(np.sum(by_component, axis=0).tolist()), change, search_every)
        self._guards = [Guard(betti, change, search_every) for betti in by_component]
        self._regions: Tensor | None = None

    def update(self, field: Values, margin: float) -> DecisiveVoxels | None:
        """See `Guard.update`."""
        labels, count = ndimage.label(field > 0)
        if count != len(self._guards):
            self._regions = None
        elif self._regions is None:
            self._regions = torch.from_numpy(_nearest_component(labels))
        if self._regions is None:
            return self._whole.update(field, margin)
        return self._update_regions(self._regions.cpu().numpy(), field, margin)

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


def _decisive_voxels(solid: Booleans, field: Values, movable: Booleans, margin: float) -> DecisiveVoxels:
    """Voxels short of the margin on the solid's side that are not simple in the solid."""
    short = movable & (np.where(solid, field, -field) < margin)
    padded = PaddedSolid(solid)
    voxels = np.argwhere(short)[~is_simple(padded.codes(padded.indices(short)))]
    sides = np.where(solid[tuple(voxels.T)], 1.0, -1.0)
    return DecisiveVoxels(torch.from_numpy(voxels), torch.from_numpy(sides))


def margin_loss(field: Field, decisive: tuple[Tensor, Tensor] | None, margin: float) -> Tensor:
    """Mean Huber loss of the decisive voxels' shortfalls, in margins; 0-d.

    Differentiable in the field's values at these voxels. It is zero without any, but has a graph to the field all the
    same, so that `backward` works. It is NaN if a value that is known without another evaluation is.
    """
    if decisive is None or len(decisive[0]) == 0:
        first = at_least_single(field.values_at(torch.zeros(1, 3, dtype=torch.int64, device=field.device)))
        loss = torch.where(first.isnan(), first, 0).sum()
    else:
        voxels, sides = decisive
        values = at_least_single(field.values_at(voxels))
        shortfalls = torch.relu(1 - sides.to(values) * values / margin)
        loss = smooth_l1_loss(shortfalls, torch.zeros_like(shortfalls), reduction="mean")
    return loss if field.is_costly else loss.masked_fill(field.detached().isnan().any(), torch.nan)
