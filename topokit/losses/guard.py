"""The guard: a hinge on the voxels that decide the topology.

Beside the solid that the field describes stands the nearest solid of the wanted topology. A voxel that is simple in it
may lie on either side; every other voxel decides the topology, and the guard asks the field to be on the solid's side
of the level there, by a margin. So a part too many loses all its voxels at once and a missing bridge gains a whole row
of them, where a critical point would be one voxel at a time; and what is right is held.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from topokit.core.grid.euler import at_least_single
from topokit.core.grid.field import Field, median_step_at_crossings
from topokit.core.homotopy.deformation import deform
from topokit.core.homotopy.nearest_solid import Betti, Change, Values, cost, nearest_solid
from topokit.core.homotopy.simple_points import Bools, PaddedSolid, is_simple

_CHEAPER = 0.5  # share of the known solid's cost below which another one is taken instead


@dataclass(frozen=True)
class Decisive:
    """Voxels that must be on a given side of the level and are not, or not by the margin.

    Attributes:
        voxels: (M, 3) int64 grid indices (x, y, z), on the CPU.
        sides: (M,) float64, +1 where the field must be above the level, -1 where below.
    """

    voxels: Tensor
    sides: Tensor


class Guard:
    """Keeps the nearest solid of a wanted topology beside one field that changes slowly, as in a training loop.

    Attributes:
        solid: (X, Y, Z) bool, or None as long as none was found.
        found: what was last found to be decisive; None without a solid.
    """

    def __init__(self, betti: Betti, change: Change, refresh: int) -> None:
        """Args: betti: components, tunnels, cavities; change: see `nearest_solid`; refresh: calls between searches."""
        self.betti = betti
        self.change = change
        self.refresh = refresh
        self.solid: Bools | None = None
        self.found: Decisive | None = None
        self._calls = 0
        self._cell = np.inf  # the field's typical change over a cell

    def decisive(self, field: Values, margin: float) -> Decisive | None:
        """What the field has to change and to hold, or None if no solid of the wanted topology is in reach.

        Args:
            field: (X, Y, Z), level subtracted, positive inside. NaN is background; infinite values cannot be moved.
            margin: by which the field has to be on the right side, or by its typical change over a cell if that is
                less: else all voxels well inside and outside would be decisive, and the whole shape be pushed.
        """
        movable = np.isfinite(field)
        if not movable.all():
            largest = np.abs(field[movable]).max(initial=0.0) or 1.0
            field = np.where(movable, field, np.where(field > 0, largest, -largest))
        self._follow(field)
        self.found = None if self.solid is None else self._choose(self.solid, field, movable, min(margin, self._cell))
        return self.found

    def _choose(self, solid: Bools, field: Values, movable: Bools, margin: float) -> Decisive:
        short = movable & (np.where(solid, field, -field) < margin)
        padded = PaddedSolid(solid)
        voxels = np.argwhere(short)[~is_simple(padded.codes(padded.indices(short)))]
        sides = np.where(solid[tuple(voxels.T)], 1.0, -1.0)
        return Decisive(torch.from_numpy(voxels), torch.from_numpy(sides))

    def _follow(self, field: Values) -> None:
        """Bring the solid up to date with the field."""
        present = field > 0
        if self.solid is not None:
            self.solid = deform(self.solid, present)
        is_due = self._calls % self.refresh == 0
        self._calls += 1
        if is_due and present.any() and not present.all():
            self._cell = median_step_at_crossings(torch.from_numpy(field)) or np.inf
        if not is_due or (self.solid is not None and np.array_equal(self.solid, present)):
            return
        found = nearest_solid(field, self.betti, self.change)
        if found is not None and (self.solid is None or cost(field, found) < _CHEAPER * cost(field, self.solid)):
            self.solid = found


def hinge(field: Field, decisive: Decisive, margin: float) -> Tensor:
    """How far the decisive voxels are from where they must be, in margins: the mean of a Huber loss, 0-d.

    Differentiable in the field's values at these voxels.
    """
    if len(decisive.voxels) == 0:
        return nothing(field)
    values = at_least_single(field.values_at(decisive.voxels))
    short = torch.relu(1 - decisive.sides.to(values) * values / margin)
    return smooth_l1_loss(short, torch.zeros_like(short), reduction="mean")


def nothing(field: Field) -> Tensor:
    """0 with a graph to the field, so that a loss which has nothing to say can still be called backward on."""
    return at_least_single(field.values_at(torch.zeros(1, 3, dtype=torch.int64)))[:0].sum()
