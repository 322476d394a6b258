"""The level set of a function in a box: its samples, its integer and what to say about it."""

from __future__ import annotations

import time
from dataclasses import dataclass

import torch
from torch import Tensor

from topokit.adapters.implicit.function import FunctionField, LevelFunction, outward
from topokit.adapters.implicit.progress import progress
from topokit.core.grid.euler import DEFAULT_CONNECTIVITY
from topokit.core.grid.surfaces import grid_surfaces
from topokit.core.implicit.adaptive_grid import FieldGrid, dense_grid, refine
from topokit.core.implicit.convergence import settle
from topokit.core.implicit.level_set import ImplicitPoint, grid_starts, implicit_curvature, project
from topokit.core.samples import SurfaceSamples
from topokit.errors import InputError
from topokit.report.function import function_answer
from topokit.report.report import CountedAnswer
from topokit.shape import Shape

Corner = tuple[float, float, float]
Bounds = tuple[Corner, Corner]
_COARSEST = 64  # cells of the grid that is evaluated at every point


@dataclass(frozen=True)
class Settings:
    """What the user asked for; see `topokit.from_sdf`.

    Raises:
        InputError: if a number makes no sense.
    """

    resolution: int
    n_samples: int
    field_resolution: int
    n_neighbors: int
    generator: torch.Generator | None

    def __post_init__(self) -> None:
        if self.resolution < 2 * _COARSEST:
            raise InputError(f"resolution is {self.resolution}; it must be at least {2 * _COARSEST}.")
        if self.field_resolution < 8:
            raise InputError(f"field_resolution is {self.field_resolution}; it must be at least 8.")
        if self.n_samples <= self.n_neighbors:
            raise InputError(
                f"n_samples is {self.n_samples}; it must be larger than n_neighbors, which is {self.n_neighbors}."
            )


class ImplicitSurface:
    """What can be found out about the zero set of a function in a box; nothing is done twice."""

    def __init__(self, function: LevelFunction, low: Corner, high: Corner, settings: Settings) -> None:
        self.function, self.low, self.high, self.settings = function, low, high, settings
        self._coarse: FieldGrid | None = None
        self._refined: FieldGrid | None = None

    def coarse(self) -> FieldGrid:
        """The grid that is evaluated in full.

        Raises:
            InputError: if the zero set does not meet the box, or the box's border is inside and its middle is not.
        """
        if self._coarse is None:
            self._coarse = dense_grid(self.function.without_graph, self.low, self.high, _COARSEST)
            _check_signs(self._coarse.values, self.function, self.low, self.high)
        return self._coarse

    def samples(self) -> SurfaceSamples:
        """Area-weighted points on the zero set with outward normals, both differentiable in f's weights.

        Raises:
            InputError: as for `coarse`.
        """
        grid = self._refined = self._refined or refine(self.coarse(), self.function.without_graph)
        points, fallback = self._points(grid)
        _, gradient = self.function.value_and_gradient(points)
        with torch.enable_grad():
            value = self.function(points)
            if not value.requires_grad:
                return _at_least_float32(points, outward(gradient, fallback))
            flat = (gradient == 0).all(-1)
            moved = ImplicitPoint.apply(
                torch.where(flat, value.detach() * 0, value), points, torch.where(flat[:, None], 1.0, gradient)
            )
            _, slope = self.function.value_and_gradient(moved, create_graph=True)
            return _at_least_float32(moved, outward(slope, fallback))

    def _points(self, grid: FieldGrid) -> tuple[Tensor, Tensor]:
        """Projected points, and the grid's normals at them; places where projection fails are drawn anew."""
        generator = self.settings.generator or torch.Generator().manual_seed(0)
        kept: list[tuple[Tensor, Tensor]] = []
        missing = self.settings.n_samples
        for _ in range(4):
            starts, normals = (
                t.to(self.function.device, self.function.dtype) for t in grid_starts(grid, missing, generator)
            )
            points, is_on = project(self.function.value_and_gradient, starts, normals, 2 * grid.step)
            kept.append((points[is_on], normals[is_on]))
            missing -= int(is_on.sum())
            if missing == 0:
                break
        points, normals = (torch.cat(column) for column in zip(*kept, strict=True))
        return points, normals

    def answer(self) -> CountedAnswer:
        """The integer, from grids that are refined to the shape's resolution."""
        started = time.perf_counter()
        function, finest = self.function, self.settings.resolution
        with progress(function, finest) as advance:
            found = settle(self.coarse(), function.without_graph, finest, advance)
        components = grid_surfaces(found.grid.values > 0, DEFAULT_CONNECTIVITY, found.grid.spacing, found.grid.origin)
        return function_answer(found, components, self.low, self.high, time.perf_counter() - started)


def _at_least_float32(points: Tensor, normals: Tensor) -> SurfaceSamples:
    """Half precision is enough for some networks, but not for differences of neighbouring points."""
    dtype = torch.promote_types(points.dtype, torch.float32)
    return SurfaceSamples(points.to(dtype), normals.to(dtype))


def analytic_curvature(shape: Shape) -> tuple[Tensor, Tensor]:
    """K and H at the samples of a `from_sdf` or `from_occupancy` shape, from the Hessian of its function.

    A second source beside `shape.curvature()`, without neighbours; meaningful where the function is twice
    differentiable (not for ReLU networks, whose Hessian vanishes almost everywhere).

    Returns:
        K (N,) in 1/length² and H (N,) in 1/length, positive where the surface bends towards its inside; detached.

    Raises:
        InputError: if the shape was not made from a function.
    """
    if not isinstance(shape.field, FunctionField):
        raise InputError(f"{shape.name} was not made by from_sdf or from_occupancy, so it has no Hessian.")
    function = shape.field.function
    points = shape.samples.points.detach().to(function.dtype)
    _, gradient = function.value_and_gradient(points)
    return implicit_curvature(-gradient, -function.hessian(points))


def _check_signs(values: Tensor, function: LevelFunction, low: Corner, high: Corner) -> None:
    inside = values > 0
    raw = function.sign * values[values.isfinite()].double() + function.level
    least, most = (f"{float(x):.4g}" for x in raw.aminmax()) if len(raw) else ("−∞", "∞")
    box = f"the box {_corner(low)} … {_corner(high)}"
    if not inside.any() or inside.all():
        side = "outside" if not inside.any() else "inside"
        raise InputError(
            f"{function.name} has no level set {function.level:g} in {box}: its values go from {least} to {most} on a "
            f"grid of {values.numel()} points, so all of it is {side}. Pass bounds around the surface, or the level."
        )
    border = torch.ones_like(inside)
    border[1:-1, 1:-1, 1:-1] = False
    if inside[border].all():
        lower = function.sign < 0
        other = "from_occupancy(f, threshold=level)" if lower else "from_sdf(f, level=threshold)"
        raise InputError(
            f"The sign of {function.name} looks inverted: all of the border of {box} is "
            f"{'below' if lower else 'above'} {function.level:g}, which means inside, and only a part of its middle is "
            f"outside. Use {other}, pass "
            "lambda x: -f(x) with −level, or, if the box lies inside the solid, larger bounds."
        )


def _corner(values: Corner) -> str:
    return "(" + ", ".join(f"{value:g}" for value in values) + ")"
