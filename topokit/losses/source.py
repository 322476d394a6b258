"""The fields in what a loss is called with: a field on a grid, a batch of them, or a shape."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from torch import Tensor

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


class SourceField(NamedTuple):
    """A field in a source.

    Attributes:
        field: level subtracted.
        n_terms: how many values the source consists of, over which data terms are means: grid points; or samples in
            units of (4π)², since one that moves by its spacing changes the winding number there by about 1/4π.
    """

    field: Field
    n_terms: float


@dataclass(frozen=True)
class FieldSource:
    """Finds the fields in a source, one per batch item.

    Attributes:
        level: of plain fields.
        connectivity: 6 or 26, of plain fields and of samples.
        resolution: the most grid points along a side for samples.
        is_log_odds: whether the values of plain fields are log-odds.

    Raises:
        InputError: if an attribute has a wrong type or value.
    """

    level: float
    connectivity: int
    resolution: int
    is_log_odds: bool = False

    def __post_init__(self) -> None:
        check_finite("level", self.level)
        check_choice("connectivity", self.connectivity, (6, 26))
        check_count("resolution", self.resolution, _LEAST_RESOLUTION)

    def __call__(self, source: Source, grids: Sequence[Grid | None] | None = None) -> list[SourceField]:
        """The fields, level subtracted.

        Args:
            source: a floating-point tensor (..., X, Y, Z), or a shape with a field or with oriented samples.
            grids: for the samples of each item, the grid of an earlier call or None. It is kept as long as the points
                fit, so that the field changes smoothly in training.

        Raises:
            InputError: if the source is neither a floating-point tensor (..., X, Y, Z), nor a shape with a field or
                with oriented samples; or if it is a shape, and there is a level or plain fields are log-odds.
        """
        if isinstance(source, Tensor):
            items = plain_field(source).reshape(-1, *source.shape[-3:])
            return [SourceField(self._grid_field(one), one.numel()) for one in items]
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
        if self.is_log_odds:
            raise InputError(
                f"logits=True is for plain fields, and {source.name} is a shape: a function says so where it becomes "
                "one, from_occupancy(net, logits=True)."
            )
        if source.field is not None:
            return [SourceField(source.field, source.field.grid.n_vertices)]
        return self._winding_fields(source, grids)

    def _grid_field(self, values: Tensor) -> GridField:
        return GridField(values - self.level, connectivity=self.connectivity, is_log_odds=self.is_log_odds)

    def _winding_fields(self, shape: Shape, grids: Sequence[Grid | None] | None) -> list[SourceField]:
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
        known = [None] * len(items) if grids is None else grids
        return [self._winding_field(item, grid) for item, grid in zip(items, known, strict=True)]

    def _winding_field(self, item: SurfaceSamples, known: Grid | None) -> SourceField:
        assert item.normals is not None
        assert item.areas is not None
        grid = self._grid_around(item, known)
        values = winding_field(item.points, item.normals, item.areas, grid).values
        return SourceField(GridField(values - 0.5, grid, self.connectivity), len(item.points) / (4 * math.pi) ** 2)

    def _grid_around(self, item: SurfaceSamples, known: Grid | None) -> Grid:
        """The known grid, or a new one if the points do not fit into it."""
        if known is not None and known.contains(item.points, _MARGIN_CELLS):
            return known
        assert item.areas is not None
        spacing = float(item.areas.detach().mean().sqrt())
        return make_grid(item.points, spacing, 1.0, self.resolution**3, self.resolution // 2)


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
