"""The fields in what a loss is called with: a field on a grid, a batch of them, or a shape."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from torch import Tensor, nn

from topokit.core.grid.euler import at_least_single
from topokit.core.grid.field import Field, GridField
from topokit.core.grid.grid import Grid, make_grid
from topokit.core.grid.winding_field import winding_field
from topokit.core.local.neighborhood_size import given_or_default
from topokit.errors import InputError
from topokit.losses.checks import check_choice, check_count, check_finite
from topokit.shape import Shape

Source = Tensor | Shape

_LEAST_RESOLUTION = 16  # grid points along a side: fewer leave no room for a solid and its margins
_MARGIN_CELLS = 4  # a new grid is made when samples come nearer than this to the border of the present one


class FieldSource(nn.Module):
    """Finds the fields in a source, one per batch item.

    For samples it makes a grid around them and keeps it as long as they fit, so that the field changes smoothly in
    training. The grid is part of the `state_dict`.
    """

    def __init__(self, level: float, connectivity: int, resolution: int) -> None:
        """Create the source.

        Args:
            level: of plain fields.
            connectivity: 6 or 26, of plain fields and of samples.
            resolution: the most grid points along a side for samples.

        Raises:
            InputError: if an argument has a wrong type or value.
        """
        super().__init__()
        check_finite("level", level)
        check_choice("connectivity", connectivity, (6, 26))
        check_count("resolution", resolution, _LEAST_RESOLUTION)
        self.level = float(level)
        self.connectivity = connectivity
        self.resolution = resolution
        self.grid: Grid | None = None

    def forward(self, source: Source) -> list[Field]:
        """The fields, level subtracted.

        Raises:
            InputError: if the source is neither a floating-point tensor (..., X, Y, Z), nor a shape with a field or
                with oriented samples; or if both a shape and a level are given.
        """
        if isinstance(source, Tensor):
            items = plain_field(source).reshape(-1, *source.shape[-3:])
            return [GridField(item - self.level, connectivity=self.connectivity) for item in items]
        if not isinstance(source, Shape):
            raise InputError(
                f"expected a field (..., X, Y, Z), positive inside, or a Shape; got {type(source).__name__}."
                + (" Wrap a network as a shape: tk.from_sdf(net)." if callable(source) else "")
            )
        if self.level:
            raise InputError(
                f"level={self.level:g} is for plain fields, and {source.name} is a shape: pass the level to from_sdf, "
                "from_occupancy or from_voxels. Samples have none."
            )
        return [source.field or self._winding_field(source)]

    def _winding_field(self, shape: Shape) -> Field:
        points = shape.samples.points
        if not shape.samples.oriented or points.ndim != 2:
            raise InputError(
                f"{shape.name} is neither a field nor one cloud with oriented normals: use shape.oriented(), or pass "
                "normals to from_points."
            )
        local = shape.curvature(given_or_default(shape.n_neighbors))
        self.grid = grid = self._grid_around(points, float(local.area.detach().mean().sqrt()))
        values = winding_field(points, local.normals, local.area, grid).values
        return GridField(values - 0.5, grid, self.connectivity)

    def _grid_around(self, points: Tensor, spacing: float) -> Grid:
        """The present grid, or a new one if the points do not fit into it."""
        if self.grid is not None and self.grid.contains(points, _MARGIN_CELLS):
            return self.grid
        return make_grid(points, spacing, 1.0, self.resolution**3, self.resolution // 2)

    def get_extra_state(self) -> dict[str, Any] | None:
        """The grid around the samples, for the `state_dict`."""
        return None if self.grid is None else asdict(self.grid)

    def set_extra_state(self, state: dict[str, Any] | None) -> None:
        """Restore the grid."""
        self.grid = None if state is None else Grid(**state)


def plain_field(field: Tensor) -> Tensor:
    """The field itself, in single precision if it came in half.

    Raises:
        InputError: if it is not a floating-point tensor (..., X, Y, Z), or has no elements.
    """
    if not field.is_floating_point() or field.ndim < 3 or field.numel() == 0:
        raise InputError(
            "expected a floating-point field (..., X, Y, Z), positive inside and not empty; got a tensor of shape "
            f"{tuple(field.shape)} and type {field.dtype}."
        )
    return at_least_single(field)
