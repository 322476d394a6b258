"""What a loss may be given: a field on a grid, a batch of them, or a shape, whose field this finds or makes."""

from __future__ import annotations

import math

from torch import Tensor

from topokit.core.grid.euler import at_least_single, check_connectivity
from topokit.core.grid.field import Field, GridField
from topokit.core.grid.grid import Grid, make_grid
from topokit.core.grid.winding_field import winding_field
from topokit.errors import InputError
from topokit.shape import Shape

_COARSEST = 16  # grid points along a side, below which there is no room for a solid and its margins
_MARGIN_CELLS = 4  # samples may come this near to the border of the grid before a new one is laid


class FieldSource:
    """Fields of what a loss is given, one per batch item; a grid laid around samples stays while they fit."""

    def __init__(self, level: float, connectivity: int, resolution: int) -> None:
        """
        Args:
            level: of plain fields.
            connectivity: of plain fields.
            resolution: grid points along a side around samples, at most.

        Raises:
            InputError: if one of them makes no sense.
        """
        if not math.isfinite(level):
            raise InputError(f"level must be a finite number, not {level}.")
        if resolution < _COARSEST:
            raise InputError(f"resolution must be at least {_COARSEST} grid points, not {resolution}.")
        self.level = level
        self.connectivity = check_connectivity(connectivity)
        self.resolution = resolution
        self._grid: Grid | None = None

    def __call__(self, source: Tensor | Shape) -> list[Field]:
        """The fields.

        Raises:
            InputError: if the source is neither a floating-point tensor (..., X, Y, Z), nor a shape with a field or
                with oriented samples; or if a shape is given and a level.
        """
        if isinstance(source, Tensor):
            items = plain_field(source).reshape(-1, *source.shape[-3:])
            return [GridField(item - self.level, connectivity=self.connectivity) for item in items]
        if not isinstance(source, Shape):
            raise InputError(
                f"the loss got {type(source).__name__}; expected a field (..., X, Y, Z), positive inside, or a Shape."
            )
        if self.level:
            raise InputError(
                f"level={self.level:g} is that of a plain field; {source.name} has its own: give it to from_sdf, "
                "from_occupancy or from_voxels. Samples have none."
            )
        return [source.field or self._of_samples(source)]

    def _of_samples(self, shape: Shape) -> Field:
        if not shape.samples.oriented or shape.samples.points.ndim != 2:
            raise InputError(
                f"{shape.name} is neither a field nor one cloud with oriented normals: use shape.oriented(), or pass "
                "normals to from_points."
            )
        local = shape.curvature()
        points = shape.samples.points
        if self._grid is None or not self._grid.contains(points, _MARGIN_CELLS):
            spacing = float(local.area.detach().mean().sqrt())
            self._grid = make_grid(points, spacing, 1.0, self.resolution**3, self.resolution // 2)
        grid = self._grid
        values = winding_field(points, local.normals, local.area, grid).values
        return GridField(values - 0.5, grid, self.connectivity)


def plain_field(field: Tensor) -> Tensor:
    """The field itself, in single precision if it came in half.

    Raises:
        InputError: if it is not a floating-point tensor (..., X, Y, Z), or has no elements.
    """
    if not field.is_floating_point() or field.ndim < 3 or field.numel() == 0:
        raise InputError(
            f"the loss got a tensor of shape {tuple(field.shape)} and type {field.dtype}; expected a floating-point "
            "field (..., X, Y, Z), positive inside and not empty."
        )
    return at_least_single(field)
