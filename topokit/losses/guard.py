"""The guard: finds the voxels that decide a field's topology, and the side of the level on which each has to be.

The guard keeps the nearest solid of the wanted topology. A voxel that is simple in this solid may be inside or outside
without consequence; every other voxel decides the topology, and the field has to be on the solid's side there, by a
margin. So all voxels of a surplus part are pushed at once, and so is the whole row of a missing bridge, where a
critical point would be one voxel at a time; and what is right already is held.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from topokit.core.grid.euler import at_least_single
from topokit.core.grid.field import Field, median_step_at_crossings
from topokit.core.homotopy.deformation import deform
from topokit.core.homotopy.nearest_solid import Betti, Change, Values, cost, nearest_solid
from topokit.core.homotopy.simple_points import Bools, PaddedSolid, is_simple

_SWITCH_BELOW = 0.5  # a newly found solid replaces the known one below this share of its cost


class DecisiveVoxels(NamedTuple):
    """Voxels that must be on a given side of the level and are not, or not by the margin.

    Attributes:
        voxels: (M, 3) int64 grid indices (x, y, z).
        sides: (M,) float64, +1 where the field must be above the level, -1 where below.
    """

    voxels: Tensor
    sides: Tensor


class Guard:
    """Tracks the nearest solid of a wanted topology for one field that changes slowly, as in a training loop.

    Attributes:
        solid: (X, Y, Z) bool, or None until one is found.
        decisive: the result of the last `update`.
    """

    def __init__(self, betti: Betti, change: Change, search_every: int) -> None:
        """Args: betti: components, tunnels, cavities; change: see `nearest_solid`; search_every: in updates."""
        self.betti = betti
        self.change = change
        self.search_every = search_every
        self.solid: Bools | None = None
        self.decisive: DecisiveVoxels | None = None
        self._n_updates = 0
        self._cell_change = np.inf  # the field's typical change over one cell

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
        self._update_solid(field)
        self.decisive = None
        if self.solid is not None:
            self.decisive = _decisive_voxels(self.solid, field, movable, min(margin, self._cell_change))
        return self.decisive

    def _update_solid(self, field: Values) -> None:
        """Let the solid follow the field, and search for a nearer one if it is time."""
        present = field > 0
        if self.solid is not None:
            self.solid = deform(self.solid, present)
        is_due = self._n_updates % self.search_every == 0
        self._n_updates += 1
        if is_due and present.any() and not present.all():
            self._cell_change = median_step_at_crossings(torch.from_numpy(field)) or np.inf
        if not is_due or (self.solid is not None and np.array_equal(self.solid, present)):
            return
        found = nearest_solid(field, self.betti, self.change)
        if found is not None and (self.solid is None or cost(field, found) < _SWITCH_BELOW * cost(field, self.solid)):
            self.solid = found

    def get_state(self) -> dict[str, Any]:
        """What has been found so far, as tensors and numbers."""
        return {
            "solid": None if self.solid is None else torch.from_numpy(self.solid),
            "decisive": self.decisive and tuple(self.decisive),
            "n_updates": self._n_updates,
            "cell_change": float(self._cell_change),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` returned."""
        self.solid = None if state["solid"] is None else state["solid"].cpu().numpy()
        self.decisive = state["decisive"] and DecisiveVoxels(*(part.cpu() for part in state["decisive"]))
        self._n_updates = state["n_updates"]
        self._cell_change = state["cell_change"]


def _decisive_voxels(solid: Bools, field: Values, movable: Bools, margin: float) -> DecisiveVoxels:
    """Voxels short of the margin on the solid's side that are not simple in the solid."""
    short = movable & (np.where(solid, field, -field) < margin)
    padded = PaddedSolid(solid)
    voxels = np.argwhere(short)[~is_simple(padded.codes(padded.indices(short)))]
    sides = np.where(solid[tuple(voxels.T)], 1.0, -1.0)
    return DecisiveVoxels(torch.from_numpy(voxels), torch.from_numpy(sides))


def margin_loss(field: Field, decisive: DecisiveVoxels | None, margin: float) -> Tensor:
    """Mean Huber loss of the decisive voxels' shortfalls, in margins; 0-d.

    Differentiable in the field's values at these voxels. It is zero without any, but has a graph to the field all the
    same, so that `backward` works. It is NaN if a value that is known without another evaluation is.
    """
    if decisive is None or len(decisive.voxels) == 0:
        first = at_least_single(field.values_at(torch.zeros(1, 3, dtype=torch.int64, device=field.device)))
        loss = torch.where(first.isnan(), first, 0).sum()
    else:
        values = at_least_single(field.values_at(decisive.voxels))
        shortfalls = torch.relu(1 - decisive.sides.to(values) * values / margin)
        loss = smooth_l1_loss(shortfalls, torch.zeros_like(shortfalls), reduction="mean")
    return loss if field.is_costly else loss.masked_fill(field.detached().isnan().any(), torch.nan)
