"""Gaussians that are asked when samples are unsure: the second witness of a shape, and a gradient of its integer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor

from topokit.core.grid.field import GridField
from topokit.core.grid.grid import Grid
from topokit.core.opacity.depth import least_depth
from topokit.core.opacity.solid import OPAQUE, Gaussians, OpacityReading, grid_around, read_opacity, typical_spacing

_STEP = 0.5  # spacings of the Gaussians, of a grid that resolves what they show


@dataclass(frozen=True, eq=False)
class AbsorbingScene:
    """A scene that absorbs light.

    Attributes:
        make: returns its Gaussians, differentiable in what they are made from.
    """

    make: Callable[[], Gaussians]

    def read(self, finer_than: float | None) -> OpacityReading | None:
        """What opacity says about the solid; see `read_opacity`."""
        return read_opacity(self.make(), finer_than)

    def smoothed_euler(self) -> Tensor | None:
        """χ_τ of the surface of the solid that cannot be seen into, 0-d float64 on the CPU; None without a graph.

        It is averaged over optical depths around log 2, by `Field.smoothed_euler` with its default τ. Differentiable in
        the Gaussians, at fixed paths of light.
        """
        gaussians = self.make()
        if not any(part.requires_grad for part in gaussians):
            return None
        depth, grid = depth_around(gaussians)
        return GridField(depth - OPAQUE, grid).smoothed_euler()


def depth_around(gaussians: Gaussians, step: float | None = None) -> tuple[Tensor, Grid]:
    """The least optical depth from outside (X, Y, Z), float64 on the CPU, on a grid around the Gaussians.

    Args:
        gaussians: at least two; the depth is differentiable in them.
        step: of the grid, in units of length; half a spacing of the Gaussians by default. It is larger where the grid
            would have too many vertices.
    """
    grid = grid_around(gaussians.means, step or _STEP * typical_spacing(gaussians.means))
    return least_depth(gaussians.extinction(grid), grid.cell), grid
