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
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError
from topokit.losses.checks import check_choice, check_count, check_finite
from topokit.shape import Shape

Source = Tensor | Shape

_LEAST_RESOLUTION = 16  # grid points along a side: fewer leave no room for a solid and its margins
_MARGIN_CELLS = 4  # a new grid is made when samples come nearer than this to the border of the present one


class FieldSource(nn.Module):
    """Finds the fields in a source, one per batch item.

    For samples it makes a grid around each cloud and keeps it as long as the points fit, so that the field changes
    smoothly in training. The grids are part of the `state_dict`.
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
        self.grids: list[Grid] = []  # around the samples of each item

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
        return [source.field] if source.field is not None else self._winding_fields(source)

    def _winding_fields(self, shape: Shape) -> list[Field]:
        """The fields of the samples of each item."""
        samples = shape.samples
        if not samples.oriented:
            raise InputError(
                f"{shape.name} is neither a field nor samples with oriented normals: use shape.oriented(), or pass "
                "normals to from_points."
            )
        local = shape.curvature(given_or_default(shape.n_neighbors))
        layer = SurfaceSamples(samples.points, local.normals, areas=local.area, lengths=samples.lengths)
        items = layer.separate()
        present = self.grids if len(self.grids) == len(items) else [None] * len(items)
        self.grids = [self._grid_around(item, grid) for item, grid in zip(items, present, strict=True)]
        return [self._winding_field(item, grid) for item, grid in zip(items, self.grids, strict=True)]

    def _winding_field(self, item: SurfaceSamples, grid: Grid) -> Field:
        assert item.normals is not None
        assert item.areas is not None
        values = winding_field(item.points, item.normals, item.areas, grid).values
        return GridField(values - 0.5, grid, self.connectivity)

    def _grid_around(self, item: SurfaceSamples, present: Grid | None) -> Grid:
        """The present grid, or a new one if the points do not fit into it."""
        if present is not None and present.contains(item.points, _MARGIN_CELLS):
            return present
        assert item.areas is not None
        spacing = float(item.areas.detach().mean().sqrt())
        return make_grid(item.points, spacing, 1.0, self.resolution**3, self.resolution // 2)

    def get_extra_state(self) -> list[dict[str, Any]]:
        """The grids around the samples, for the `state_dict`."""
        return [asdict(grid) for grid in self.grids]

    def set_extra_state(self, state: list[dict[str, Any]]) -> None:
        """Restore the grids."""
        self.grids = [Grid(**grid) for grid in state]


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
