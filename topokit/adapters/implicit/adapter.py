"""Signed distance and occupancy networks, and any other function whose level set is a surface."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from numbers import Real
from typing import Any

import torch
from numpy.typing import ArrayLike
from torch import Tensor

from topokit.adapters.implicit.box import UNIT_CUBE, as_bounds, find_bounds
from topokit.adapters.implicit.files import read_network
from topokit.adapters.implicit.function import BATCH_SIZE, Function, FunctionField, LevelFunction
from topokit.adapters.implicit.surface import COARSEST, Bounds, ImplicitSurface
from topokit.core.draws import check_sample_count, deferred_seed
from topokit.core.grid.euler import DEFAULT_CONNECTIVITY
from topokit.core.grid.grid import Grid
from topokit.core.implicit.blockwise import Blocks
from topokit.core.local.neighborhood_size import given_or_default
from topokit.errors import InputError, Option
from topokit.inputs.arrays import as_positions
from topokit.inputs.calls import options_by_name
from topokit.inputs.files import existing_file
from topokit.inputs.remote import is_address
from topokit.plugins.programs import not_named
from topokit.shape import Shape

_EVEN = 0.5  # the level of occupancies: probabilities, where nothing else is given
_N_PROBES = 5  # points of the first call: neither 1 nor 3, so that wrong shapes are recognized
_RANDOM_IN_TRAINING = (torch.nn.modules.dropout._DropoutNd, torch.nn.modules.batchnorm._BatchNorm)


@options_by_name("bounds")
def from_sdf(
    f: Function | str | os.PathLike[str],
    *,
    bounds: Bounds | tuple[float, float] | None = None,
    level: float = 0.0,
    resolution: int = 512,
    n_samples: int = 10_000,
    field_resolution: int = 64,
    starts: Tensor | ArrayLike | None = None,
    n_neighbors: int | None = None,
    generator: torch.Generator | None = None,
    batch_size: int = BATCH_SIZE,
    block_voxels: int | None = None,
    client: Any = None,
) -> Shape:
    """The surface {f = level} of a function that is lower inside, such as a signed distance network.

    f need not be a distance: only its sign is used, and where it may change. Everything is computed when it is first
    asked for. `report()` counts χ on grids from 64 to `resolution` cells, those of more than 256 cells block by block,
    in memory that does not depend on the resolution. The first grid is evaluated at all of its points (0.27 million, or
    2.1 million of 128 cells where f jumps to a constant within a cell, as steep occupancies do), the others near the
    surface: at 512 cells three to eight million in all.
    `gauss_bonnet()` and `curvature()` use samples, the smoothed χ uses the field's own grid. Both are differentiable in
    whatever f was computed from; samples move along their normals (implicit function theorem), and which are drawn
    is held fixed: a new shape draws anew unless it has `starts`. f must not change in between, and a network
    whose weights have changed since is refused by `report()`; but `smoothed_euler()` and the losses evaluate it anew in
    every call, so that one shape serves them for a whole training. Pass `bounds` then: to find them takes evaluations.

    A network with a latent code is a function of points once the code is fixed. Gradients reach the code:
    `from_sdf(lambda x: decoder(torch.cat((code.expand(len(x), -1), x), dim=1)), bounds=box)`.

    Args:
        f: any callable, `nn.Module` or not, compiled or not, on any device and of any floating type, that maps (N, 3)
            points to (N,) or (N, 1); or the path of a TorchScript or torch.export file, which is a program and runs:
            give only files that you would run.
        bounds: lowest and highest corner of the box that holds the surface, or two numbers for a cube. By default
            [−1, 1]³, doubled up to six times while the surface touches it; if that does not help, [−1, 1]³.
        level: value of f on the surface.
        resolution: cells along the longest side of the finest grid of `report()`, at least 128; each doubling costs
            about four times as many evaluations.
        n_samples: number of samples.
        field_resolution: cells along the longest side of the field's own grid, which is evaluated everywhere.
        starts: (N, 3) points near the surface, such as the samples of the last training step. They become the samples,
            moved along the gradient by at most 1/64 of the longest side; those too far away are left out.
            This takes about 10 N evaluations instead of the half million of grids, but parts of the surface without
            starts are not seen, and the samples grow uneven: leave starts out now and then.
        n_neighbors: number of nearest neighbors for curvature; None takes 20, or more where the samples are noisy.
        generator: source of randomness; a seed is drawn from it at once. Seed 0 if None.
        batch_size: points per call of f, at most, up to 65 536: fewer for functions that need much memory for each
            point. Where a call runs out of memory it is halved by itself. The integers do not depend on it.
        block_voxels: grid points in a block, at most; by default 2²¹.
        client: a `dask.distributed.Client` whose workers evaluate the blocks, to which f is sent; by default this
            process, one by one.

    Raises:
        ReadError: if a file is missing, malformed, or a pickle.
        InputError: if f returns the wrong shape or NaN, has no level set in the box, or has the sign of an occupancy;
            or if the box, the level, a resolution or n_samples is not usable.

    Example:
        >>> import topokit as tk
        >>> tk.from_sdf(lambda x: x.norm(dim=1) - 0.7, resolution=128).report().euler
        2
    """
    name, function = _name_and_function(f, "sdf", "from_sdf")
    blocks = _blocks(block_voxels, client)
    sizes = resolution, n_samples, field_resolution, batch_size
    settings = _Settings(bounds, level, *sizes, starts, n_neighbors, generator, blocks)
    return _shape(name, function, -1, settings)


@options_by_name("bounds")
def from_occupancy(
    f: Function | str | os.PathLike[str],
    *,
    bounds: Bounds | tuple[float, float] | None = None,
    level: float = _EVEN,
    logits: bool = False,
    resolution: int = 512,
    n_samples: int = 10_000,
    field_resolution: int = 64,
    starts: Tensor | ArrayLike | None = None,
    n_neighbors: int | None = None,
    generator: torch.Generator | None = None,
    batch_size: int = BATCH_SIZE,
    block_voxels: int | None = None,
    client: Any = None,
) -> Shape:
    """The surface {f = level} of a function that is higher inside, such as an occupancy network.

    Args:
        f: as for `from_sdf`.
        bounds: as for `from_sdf`.
        level: value of f on the surface, a probability. At 0.5 values below −0.1 are refused, as those of a signed
            distance or of log-odds; for other functions give their level.
        logits: whether f returns log-odds instead of probabilities; `level` still is a probability. Gradients of
            log-odds do not vanish far from the surface.
        resolution: as for `from_sdf`.
        n_samples: number of samples.
        field_resolution: as for `from_sdf`.
        starts: as for `from_sdf`.
        n_neighbors: number of nearest neighbors for curvature; None takes 20, or more where the samples are noisy.
        generator: as for `from_sdf`.
        batch_size: as for `from_sdf`.
        block_voxels: as for `from_sdf`.
        client: as for `from_sdf`.

    Raises:
        ReadError, MissingDependencyError, InputError: as for `from_sdf`.

    Example:
        >>> import topokit as tk
        >>> ball = lambda x: (10 * (0.7 - x.norm(dim=1))).sigmoid()
        >>> tk.from_occupancy(ball, resolution=128).report().euler
        2
    """
    name, function = _name_and_function(f, "occupancy", "from_occupancy")
    on_surface = _log_odds(level) if logits else level
    blocks = _blocks(block_voxels, client)
    sizes = resolution, n_samples, field_resolution, batch_size
    settings = _Settings(bounds, on_surface, *sizes, starts, n_neighbors, generator, blocks)
    return _shape(name, function, 1, settings, not logits and level == _EVEN, logits)


def _blocks(block_voxels: int | None, client: Any) -> Blocks:
    if block_voxels is not None and block_voxels < 1:
        raise InputError(f"block_voxels must be at least 1, not {block_voxels}.")
    return Blocks(client=client) if block_voxels is None else Blocks(block_voxels, client)


def _log_odds(probability: float) -> float:
    if not isinstance(probability, Real) or not 0 < probability < 1:
        wrong = f" level is a probability between 0 and 1, got {probability!r}."
        raise InputError("with ", Option("logits", "True"), wrong)
    return math.log(probability / (1 - probability))


@dataclass(frozen=True)
class _Settings:
    """The keywords of `from_sdf` and `from_occupancy`.

    Raises:
        InputError: if one of them is not usable.
    """

    bounds: Bounds | tuple[float, float] | None
    level: float
    resolution: int
    n_samples: int
    field_resolution: int
    batch_size: int
    starts: Tensor | ArrayLike | None
    n_neighbors: int | None
    generator: torch.Generator | None
    blocks: Blocks

    def __post_init__(self) -> None:
        if not isinstance(self.level, Real) or not math.isfinite(self.level):
            raise InputError(f"level must be a finite number, got {self.level!r}.")
        if self.resolution < 2 * COARSEST:
            raise InputError(
                f"resolution is {self.resolution}; it must be at least {2 * COARSEST} cells: an answer counts only "
                "if coarser grids repeat it."
            )
        if self.field_resolution < 8:
            raise InputError(f"field_resolution is {self.field_resolution}; it must be at least 8.")
        if not 1 <= self.batch_size <= BATCH_SIZE:
            raise InputError(f"batch_size is {self.batch_size}; it must be from 1 to {BATCH_SIZE} points.")
        check_sample_count(self.n_samples, given_or_default(self.n_neighbors))


def _shape(
    name: str,
    f: Function,
    sign: int,
    settings: _Settings,
    is_probability: bool = False,
    is_log_odds: bool = False,
) -> Shape:
    bounds = UNIT_CUBE if settings.bounds is None else as_bounds(settings.bounds)
    function = LevelFunction(f, settings.level, sign, name, _probes(bounds), settings.batch_size, is_probability)
    notes: tuple[str, ...] = ()
    if settings.bounds is None:
        bounds, notes = find_bounds(function)
    if function.dtype.itemsize < 4:
        notes += (f"{name} computes in {function.dtype}, which blurs positions: convert it to float32 for fine grids.",)
    seed = deferred_seed(settings.generator)
    starts = None if settings.starts is None else as_positions(settings.starts, "starts")
    sizes = settings.resolution, settings.n_samples
    surface = ImplicitSurface(function, bounds, *sizes, seed, settings.blocks, starts)
    grid = Grid.covering(*bounds, settings.field_resolution)
    field = FunctionField(function, grid, DEFAULT_CONNECTIVITY, is_log_odds)
    return Shape(
        surface.samples,
        surface.answer,
        surface=surface.triangles,
        bounded=surface,
        field=field,
        name=name,
        notes=notes,
        n_neighbors=settings.n_neighbors,
    )


def _probes(bounds: Bounds) -> torch.Tensor:
    """Random points (5, 3) in the box for the first call."""
    low, high = torch.tensor(bounds, dtype=torch.float64)
    generator = torch.Generator().manual_seed(0)
    return low + (high - low) * torch.rand(_N_PROBES, 3, generator=generator, dtype=torch.float64)


def _name_and_function(source: object, kind: str, caller: str) -> tuple[str, Function]:
    """The file's name and the network in it, or `kind` and the callable itself."""
    if isinstance(source, str | os.PathLike):
        if is_address(source):
            raise InputError(not_named(source, kind))
        path = existing_file(source)
        return path.name, read_network(path)
    if isinstance(source, torch.nn.Module) and source.training:
        random = {type(part).__name__ for part in source.modules() if isinstance(part, _RANDOM_IN_TRAINING)}
        if random:
            raise InputError(
                f"the network is in training mode and has {', '.join(sorted(random))}, so its values depend on chance "
                "or on the other points of a batch: call .eval() on it first."
            )
    if not callable(source):
        raise InputError(
            f"{caller} got {type(source).__name__}; expected a callable on (N, 3) tensors or the path of a network. "
            "For values on a grid use topokit.from_voxels."
        )
    return kind, source
