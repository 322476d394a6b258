"""The level set of a function in a box: its samples and its counted answer."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import torch
from torch import Tensor

from topokit.adapters.implicit.function import LevelFunction, uncompiled
from topokit.core.blocks.whole import count_solid
from topokit.core.components import Corner, CountedComponents
from topokit.core.grid.euler import DEFAULT_CONNECTIVITY
from topokit.core.grid.grid import Grid
from topokit.core.grid.level_surface import level_surface
from topokit.core.implicit.adaptive_grid import (
    AdaptiveField,
    dense_field,
    grid_stages,
    refine_grid,
    refined_everywhere,
)
from topokit.core.implicit.block_components import components_in_blocks
from topokit.core.implicit.blockwise import Blocks
from topokit.core.implicit.bounds.operations import program_of
from topokit.core.implicit.bounds.program import Program
from topokit.core.implicit.certificate.cells import Effort
from topokit.core.implicit.certificate.proof import prove
from topokit.core.implicit.convergence import ConvergenceStudy, convergence_study
from topokit.core.implicit.level_set import (
    area_weighted_starts,
    edge_crossings,
    follow,
    implicit_point,
    outward_normals,
    project,
)
from topokit.core.implicit.unseen_parts import carries_distance, count_hidden
from topokit.core.progress import stages
from topokit.core.samples import SurfaceSamples
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError, Option
from topokit.report.certificate import Certificate, certificate, with_proof
from topokit.report.counted import CountedAnswer
from topokit.report.function import function_answer
from topokit.report.progress import progress_bar

Bounds = tuple[Corner, Corner]
COARSEST = 64  # cells of the grid that is evaluated at every vertex
_MOST_CELLS = 512  # along the longest side of a grid that is held in memory
_BELOW_ZERO = -0.1  # values of a network that was fitted to 0 and 1 may ripple as far as that
_CHECKED_CELLS = 15  # of the grid on which the operations of a proof are compared with their function
_CHECKED_DIGITS = 2.0**14  # by which its own rounding may be larger than that of one operation
_MOST_EVALUATIONS = 1 << 23  # that a proof beside grids may cost: half of what grids of 512 cells take
_DRAWS = 4  # at most, of samples where projection has failed


class ImplicitSurface:
    """The zero set of a function in a box; its coarsest grid serves both samples and counts.

    Args:
        function: positive inside.
        bounds: lowest and highest corner of the box.
        resolution: cells along the longest side of the finest grid for counting.
        n_samples: number of samples.
        seed: of the samples.
        blocks: how grids that are too large for memory are divided.
        starts: (N, 3), from which samples are found instead of from a grid; None for the grid.
    """

    def __init__(
        self,
        function: LevelFunction,
        bounds: Bounds,
        resolution: int,
        n_samples: int,
        seed: int,
        blocks: Blocks,
        starts: Tensor | None = None,
    ) -> None:
        self.function = function
        self.bounds = bounds
        self.resolution = resolution
        self.n_samples = n_samples
        self.seed = seed
        self.starts = starts
        self.blocks = blocks
        self._versions: tuple[int, ...] | None = None  # of the weights that the grids were evaluated with
        self._coarsest: AdaptiveField | None = None
        self._n_cells: int | None = None  # of the grid that shows the answer
        self._answer: CountedAnswer | None = None
        self._finest: Grid | None = None
        self._n_evaluations = 0  # of the grids that gave the answer
        self._witnessed: CountedAnswer | None = None

    def samples(self) -> SurfaceSamples:
        """Area-weighted points on the zero set with outward normals, both differentiable in f's weights.

        Raises:
            InputError: if the zero set does not meet the box, or the box's border is inside and its middle is not; or
                if there are starts, and none of them is near the zero set.
        """
        points, grid_normals = self._projected_points() if self.starts is None else self._followed(self.starts)
        _, gradient = self.function.value_and_gradient(points)
        with torch.enable_grad(), uncompiled():
            value = self.function(points)
            if not value.requires_grad:
                return _at_least_float32(points, outward_normals(gradient, grid_normals))
            moved = implicit_point(value, points, gradient)
            _, slope = self.function.value_and_gradient(moved, create_graph=True)
            return _at_least_float32(moved, outward_normals(slope, grid_normals))

    def _projected_points(self) -> tuple[Tensor, Tensor]:
        """Points on the zero set, and the grid's normals there; points whose projection fails are drawn again."""
        with self._shown(2 * COARSEST):
            field = self._coarsest_field()
            if field.grid.n_cells < 2 * COARSEST:
                field = refine_grid(field, self.function.without_graph).field
        generator = torch.Generator().manual_seed(self.seed)
        kept: list[tuple[Tensor, Tensor]] = []
        missing = self.n_samples
        for _ in range(_DRAWS):
            starts, normals = (
                values.to(self.function.device, self.function.dtype)
                for values in area_weighted_starts(field.values, field.grid, missing, generator)
            )
            points, is_on = project(self.function.value_and_gradient, starts, normals, 2 * field.grid.step)
            kept.append((points[is_on], normals[is_on]))
            missing -= int(is_on.sum())
            if missing == 0:
                break
        points, normals = (torch.cat(column) for column in zip(*kept, strict=True))
        return points, normals

    def _followed(self, starts: Tensor) -> tuple[Tensor, Tensor]:
        """The starts moved onto the zero set, and normals; those that do not reach it are left out."""
        starts = starts.detach().to(self.function.device, self.function.dtype)
        reach = 2 * Grid.covering(*self.bounds, 2 * COARSEST).step
        points, normals = follow(self.function.value_and_gradient, starts, reach)
        if len(points) == 0:
            raise InputError(
                f"none of the {len(starts)} starts is within {reach:.3g} of the level set of {self.function.name}: "
                "leave starts out, so that it is looked for on grids."
            )
        return points, normals

    def answer(self) -> CountedAnswer:
        """The integer, from grids that are refined up to the resolution.

        Raises:
            InputError: as for `samples`; or if the weights of the network have changed since a grid was evaluated.
        """
        self._require_same_weights()
        if self._answer is None:
            started = time.perf_counter()
            with self._shown(self.resolution):
                coarsest = self._coarsest_field()
                study = convergence_study(coarsest, self.function.without_graph, self.resolution, self.blocks)
            self._n_cells, self._finest, self._n_evaluations = study.shown.n_cells, study.finest, study.n_evaluations
            components = self._components(study)
            has_distance = carries_distance(coarsest.values)
            seconds = time.perf_counter() - started
            self._answer = function_answer(study, has_distance, components, *self.bounds, seconds)
        return self._answer

    def _require_same_weights(self) -> None:
        """Refuse to answer about a network that was trained on with what was measured before."""
        versions = self.function.versions()
        if self._versions is None:
            self._versions = versions
        if self._versions != versions:
            raise InputError(
                f"the weights of {self.function.name} have changed since this shape was measured: make it again from "
                "the network, topokit.from_sdf(net) or from_occupancy(net)."
            )

    def _components(self, study: ConvergenceStudy) -> CountedComponents:
        """The closed surfaces on the grid that shows the answer."""
        if study.field is not None:
            values = study.field.values
            return count_solid(values, lambda part: part > 0, DEFAULT_CONNECTIVITY, study.shown).surfaces
        return components_in_blocks(study.known, DEFAULT_CONNECTIVITY, self.blocks)

    def certificate(self, seconds: float) -> Certificate:
        """What bounds of the function and its gradient prove within so many seconds.

        Raises:
            InputError: if an operation of the function has no bounds, or the operations do not give its values.
        """
        proof = prove(self._program(), *self.bounds, Effort(seconds=seconds))
        return certificate(self.function.name, proof, *self.bounds)

    def witnessed(self) -> CountedAnswer:
        """The answer of grids with what bounds prove for as many evaluations; of grids alone if there are no bounds.

        Raises:
            InputError: as for `samples`.
        """
        counted = self.answer()
        if self._witnessed is None:
            try:
                program = self._program()
            except InputError:
                self._witnessed = counted
            else:
                self._witnessed = self._with_proof(counted, program)
        return self._witnessed

    def _with_proof(self, counted: CountedAnswer, program: Program) -> CountedAnswer:
        finest = self._finest
        assert finest is not None
        proof = prove(program, *self.bounds, Effort(evaluations=min(self._n_evaluations, _MOST_EVALUATIONS)))
        n_hidden = count_hidden(self.function.without_graph, finest, torch.from_numpy(proof.centers))
        return with_proof(counted, certificate(self.function.name, proof, *self.bounds), n_hidden, finest.step)

    def _program(self) -> Program:
        """The function's operations.

        Raises:
            InputError: as for `certificate`.
        """
        function = self.function
        example = torch.zeros(1, 3, dtype=function.dtype, device=function.device)
        with uncompiled():
            program = program_of(
                lambda x: function.sign * (function.f(x).reshape(-1) - function.level), example, function.name
            )
        _check_values(program, function, Grid.covering(*self.bounds, _CHECKED_CELLS))
        return program

    def triangles(self) -> TriangleSurface:
        """The zero set as triangles on the coarsest grid that shows the counted integer, its vertices on the zero set.

        The grid is evaluated again: kept in memory it would cost more than the surface.

        Raises:
            InputError: as for `samples`; or if that grid is too large for memory.
        """
        if self._n_cells is None:
            self.answer()
        if (self._n_cells or COARSEST) > _MOST_CELLS:
            raise InputError(
                f"the surface of {self.function.name} is seen only on a grid of {self._n_cells} cells, and triangles "
                f"are made on at most {_MOST_CELLS}: pass bounds around a part of it."
            )
        with self._shown(self._n_cells or COARSEST):
            field = self._coarsest_field()
            while field.grid.n_cells != self._n_cells:
                field = refine_grid(field, self.function.without_graph).field
        locate = partial(edge_crossings, self.function.without_graph)
        return level_surface(field.values, field.grid, DEFAULT_CONNECTIVITY, locate)

    @contextmanager
    def _shown(self, finest: int) -> Iterator[None]:
        """A block that evaluates grids up to so many cells, with a bar where that takes long."""
        with progress_bar([self.function.name]), stages(grid_stages(COARSEST, finest)):
            yield

    def _coarsest_field(self) -> AdaptiveField:
        """The field on the coarsest grid, evaluated at every vertex, once: a finer one for steep occupancies."""
        self._require_same_weights()
        if self._coarsest is None:
            grid = Grid.covering(*self.bounds, COARSEST // 2).refined()  # an even number of cells along each axis
            field = dense_field(self.function.without_graph, grid)
            _check_signs(field.values, self.function, self.bounds)
            if not carries_distance(field.values):
                field = refined_everywhere(field, self.function.without_graph)
            self._coarsest = field
        return self._coarsest


def _check_values(program: Program, function: LevelFunction, grid: Grid) -> None:
    """Refuse operations that do not give the values of their function, as where these depend on more than the point."""
    points = grid.positions(torch.arange(grid.n_vertices))
    found = program.forms(points, points[:0])[-1].center[:, 0]
    values = function.without_graph(points).double()
    error = float((found - values).abs().max())
    allowed = _CHECKED_DIGITS * torch.finfo(function.dtype).eps * max(1.0, float(values.abs().max()))
    if not error <= allowed:
        raise InputError(
            f"the operations of {function.name} give other values than it does, by up to {error:.3g}: its values must "
            "depend on the point alone, without randomness or branches, so that something can be proven."
        )


def _at_least_float32(points: Tensor, normals: Tensor) -> SurfaceSamples:
    """Half precision is enough for some networks, but not for differences of neighboring points."""
    dtype = torch.promote_types(points.dtype, torch.float32)
    return SurfaceSamples(points.to(dtype), normals.to(dtype))


def _check_signs(values: Tensor, function: LevelFunction, bounds: Bounds) -> None:
    inside = values > 0
    finite = function.sign * values[values.isfinite()].double() + function.level
    least, most = (f"{float(x):.4g}" for x in finite.aminmax()) if len(finite) else ("−∞", "∞")
    box = "the box " + " … ".join("(" + ", ".join(f"{x:g}" for x in corner) + ")" for corner in bounds)
    if not inside.any() or inside.all():
        side = "outside" if not inside.any() else "inside"
        raise InputError(
            f"{function.name} has no level set {function.level:g} in {box}: its values go from {least} to {most} on a "
            f"grid of {values.numel()} points, so all of it is {side}. Pass bounds around the surface, or the level."
        )
    border = torch.ones_like(inside)
    border[1:-1, 1:-1, 1:-1] = False
    mostly_inside = float(inside[border].float().mean()) > 0.5
    if function.is_probability and len(finite) and float(finite.min()) < (0 if mostly_inside else _BELOW_ZERO):
        raise InputError(
            f"the values of {function.name} go from {least} to {most} in {box}, so they are no probabilities. Use "
            "from_sdf for a signed distance, ",
            *(Option("logits", "True"), " for log-odds, or give the level of what else they are."),
        )
    if inside[border].all():
        side, other = ("below", "from_occupancy") if function.sign < 0 else ("above", "from_sdf")
        raise InputError(
            f"The sign of {function.name} looks inverted: all of the border of {box} is {side} {function.level:g}, "
            "which means inside, and only a part of its middle is outside. Use "
            f"{other}(f, level={function.level:g}), or, if the box lies inside the solid, larger bounds."
        )
