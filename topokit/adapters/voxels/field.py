"""The field of a volume: gray values minus their level, or what has one of the labels."""

from __future__ import annotations

from functools import reduce

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from topokit.core.arrays import Integers
from topokit.core.grid.euler import surface_euler
from topokit.core.grid.field import Field
from topokit.core.grid.grid import Grid
from topokit.core.grid.level_surface import level_surface
from topokit.core.grid.placement import Placement
from topokit.core.surface import TriangleSurface

SLAB = 16  # layers handled at a time
Labels = tuple[float, ...]


def listed(labels: Labels) -> str:
    """Labels in a sentence."""
    return " or ".join(f"{label:.15g}" for label in labels)


class VoxelField(Field):
    """Gray values minus their level, or +½ and −½ for a binary volume or for labels."""

    def __init__(
        self,
        volume: Tensor,
        level: float,
        labels: Labels,
        grid: Grid,
        connectivity: int,
        placement: Placement | None = None,
        is_cut_out: bool = False,
        given_type: torch.dtype | None = None,
    ) -> None:
        """Take a volume.

        Args:
            volume: (X, Y, Z).
            level: voxels above it are inside.
            labels: voxels equal to one of them are inside, if there are any.
            grid: voxel centers.
            connectivity: 6 or 26, that of the solid.
            placement: of the whole volume that this one may be a box of; that of the grid if None.
            is_cut_out: whether it is taken for a box of a larger body.
            given_type: in which the values came, which torch may not be able to compare; their own if None.
        """
        super().__init__(grid, connectivity)
        self.placement = placement or Placement(grid.spacing, grid.origin)
        self.is_cut_out, self.given_type = is_cut_out, given_type or volume.dtype
        self.volume, self.level, self.labels = volume, level, labels
        self.is_binary = bool(labels) or volume.dtype == torch.bool

    @property
    def device(self) -> torch.device:
        """See `Field.device`."""
        return self.volume.device

    def values(self) -> Tensor:
        """See `Field.values`; NaN becomes −∞, which is background whatever the level."""
        return self._field_of(self.volume)

    def gray_values(self) -> tuple[Tensor, float]:
        """See `Field.gray_values`: the volume as it is, or 1 where a label is and 0 elsewhere."""
        return (self.is_inside(self.volume), 0.0) if self.labels else (self.volume.detach(), self.level)

    def values_at(self, vertices: Tensor) -> Tensor:
        """See `Field.values_at`."""
        x, y, z = vertices.unbind(1)
        return self._field_of(self.volume[x, y, z])

    def exact_euler(self, connectivity: int | None = None) -> Tensor:
        """See `Field.exact_euler`; counted on the volume as it is, without a copy in floating point."""
        connectivity = connectivity or self.connectivity
        if self.labels:
            return surface_euler(self.is_inside(self.volume), 0, connectivity)
        return surface_euler(self.volume.detach(), self.level, connectivity)

    def surface(self) -> TriangleSurface:
        """The closed surface as triangles, in the field's own connectivity."""
        return level_surface(self.detached(), self.grid, self.connectivity)

    def surface_in_boxes(self, first: Integers, size: Integers, flipped: Integers) -> TriangleSurface | None:
        """The surface in boxes of the volume that are put in a row, closed at their sides; None if there is none.

        Args:
            first: (N, 3) index of the first voxel of each box; beyond the volume is background.
            size: (3,) voxels along each axis. Box n begins at n (size[0] + 1) along the first axis, and at 0.
            flipped: (M, 3) indices of voxels that are taken to be as deep on the other side of the surface.
        """
        index, is_known = [], np.ones((len(first), *size), dtype=bool)
        for axis, (length, n) in enumerate(zip(self.volume.shape, size.tolist(), strict=True)):
            at = (first[:, axis, None] + np.arange(n)).reshape([-1, *(n if k == axis else 1 for k in range(3))])
            is_known &= (at >= 0) & (at < length)
            index.append(at.clip(0, length - 1))
        values = self._field_of(self.volume.detach().cpu()[tuple(map(torch.from_numpy, index))])
        if len(flipped):
            names = np.ravel_multi_index(tuple(flipped.T), self.volume.shape)
            own = np.ravel_multi_index(tuple(np.broadcast_arrays(*index)), self.volume.shape)
            values = torch.where(torch.from_numpy(np.isin(own, names)), -values, values)
        values = torch.where(torch.from_numpy(is_known), values, -torch.inf)
        _, y, z = size.tolist()
        row = pad(values, (0, 0, 0, 0, 0, 1), value=-torch.inf).reshape(-1, y, z)
        if not (row > 0).any():
            return None
        return level_surface(row, Grid((len(row), y, z), self.grid.spacing), self.connectivity)

    def is_inside(self, voxels: Tensor) -> Tensor:
        """Which of some voxels of the volume are in the solid, bool of their shape; not to be written to."""
        if not self.labels:
            is_as_it_is = voxels.dtype == torch.bool and 0 <= self.level < 1
            return voxels.detach() if is_as_it_is else voxels.detach() > self.level
        return reduce(torch.logical_or, (voxels == label for label in self.labels))

    def _field_of(self, voxels: Tensor) -> Tensor:
        if self.is_binary:
            return self.is_inside(voxels).to(torch.get_default_dtype()) - 0.5
        gray = voxels if voxels.is_floating_point() else voxels.to(torch.get_default_dtype())
        return torch.where(gray.isnan(), -torch.inf, gray) - self.level
