"""Signed distance and occupancy networks, and any other function whose level set is a surface."""

from __future__ import annotations

import os

import torch

from topokit.adapters.implicit.files import read_network
from topokit.adapters.implicit.function import Function, FunctionField, LevelFunction
from topokit.adapters.implicit.surface import Bounds, Corner, ImplicitSurface, Settings
from topokit.core.grid.euler import DEFAULT_CONNECTIVITY
from topokit.core.implicit.adaptive_grid import dense_grid
from topokit.core.implicit.convergence import reached_faces
from topokit.core.local.curvature import DEFAULT_NEIGHBORS
from topokit.errors import InputError
from topokit.inputs.files import existing_file
from topokit.shape import Shape

_LOOK = 32  # cells of the grids that look for bounds
_UNSTEADY = (torch.nn.modules.dropout._DropoutNd, torch.nn.modules.batchnorm._BatchNorm)
_DOUBLINGS = 6  # from [−1, 1]³ to [−64, 64]³


def from_sdf(
    f: Function | str | os.PathLike[str],
    bounds: Bounds | None = None,
    level: float = 0.0,
    resolution: int = 512,
    n_samples: int = 10_000,
    *,
    field_resolution: int = 64,
    n_neighbors: int = DEFAULT_NEIGHBORS,
    generator: torch.Generator | None = None,
) -> Shape:
    """The surface {f = level} of a function that is lower inside, such as a signed distance network.

    f need not be a distance: only its sign, and where it may change, is used. All is found when it is first asked
    for: `report()` counts χ on grids from 64 to `resolution` cells, evaluating only near the surface; `euler()` and
    `curvature()` use samples, `euler(method="field")` the field's own grid; both are differentiable in whatever f was
    computed from (at fixed samples' feet, by the implicit function theorem). f must not change in between.

    Args:
        f: any callable, `nn.Module` or not, on any device and floating type, that maps (N, 3) points to (N,) or (N, 1);
            or the path of a TorchScript or torch.export file.
        bounds: lowest and highest corner of the box to look in. By default [−1, 1]³, doubled up to six times while the
            surface touches it; if that does not help, [−1, 1]³ after all.
        level: value of f on the surface.
        resolution: cells along the longest side of the finest grid of `report()`, at least 128; each doubling costs
            about four times as many evaluations.
        n_samples: number of samples.
        field_resolution: cells along the longest side of the field's own grid, evaluated in full.
        n_neighbors: k of the local half.
        generator: source of randomness (CPU); seed 0 if None.

    Raises:
        ReadError: if a file is missing, malformed, or a pickle.
        InputError: if f returns the wrong shape or NaN, has no level set in the box, or has the sign of an occupancy;
            or if the box, a resolution or n_samples makes no sense.

    Example:
        >>> import topokit as tk
        >>> tk.from_sdf(lambda x: x.norm(dim=1) - 0.7, resolution=128).report().euler
        2
    """
    settings = Settings(resolution, n_samples, field_resolution, n_neighbors, generator)
    return _shape(f, bounds, level, -1, settings)


def from_occupancy(
    f: Function | str | os.PathLike[str],
    threshold: float = 0.5,
    bounds: Bounds | None = None,
    resolution: int = 512,
    n_samples: int = 10_000,
    *,
    field_resolution: int = 64,
    n_neighbors: int = DEFAULT_NEIGHBORS,
    generator: torch.Generator | None = None,
) -> Shape:
    """The surface {f = threshold} of a function that is higher inside, such as an occupancy network.

    Args:
        f: as for `from_sdf`. For probabilities 0.5 is the usual threshold, for logits 0.
        threshold: value of f on the surface.
        bounds: as for `from_sdf`.
        resolution: as for `from_sdf`.
        n_samples: number of samples.
        field_resolution: as for `from_sdf`.
        n_neighbors: k of the local half.
        generator: source of randomness (CPU); seed 0 if None.

    Raises:
        ReadError, InputError: as for `from_sdf`.

    Example:
        >>> import topokit as tk
        >>> ball = lambda x: (10 * (0.7 - x.norm(dim=1))).sigmoid()
        >>> tk.from_occupancy(ball, resolution=128).report().euler
        2
    """
    settings = Settings(resolution, n_samples, field_resolution, n_neighbors, generator)
    return _shape(f, bounds, threshold, 1, settings)


def _shape(source: object, bounds: Bounds | None, level: float, sign: int, settings: Settings) -> Shape:
    name, f = _opened(source, sign)
    low, high = _checked_bounds(bounds) if bounds is not None else ((-1.0,) * 3, (1.0,) * 3)
    generator = torch.Generator().manual_seed(0)
    middle = torch.tensor(low).double(), torch.tensor(high).double()
    probe = middle[0] + (middle[1] - middle[0]) * torch.rand(5, 3, generator=generator, dtype=torch.float64)
    function = LevelFunction(f, level, sign, name, probe)
    notes: tuple[str, ...] = ()
    if bounds is None:
        low, high, notes = _grown(function)
    if function.dtype.itemsize < 4:
        notes += (f"{name} computes in {function.dtype}, which blurs positions: convert it to float32 for fine grids.",)
    surface = ImplicitSurface(function, low, high, settings)
    field = FunctionField(function, low, high, settings.field_resolution, DEFAULT_CONNECTIVITY)
    return Shape(surface.samples, surface.answer, field=field, name=name, notes=notes, n_neighbors=settings.n_neighbors)


def _opened(source: object, sign: int) -> tuple[str, Function]:
    caller = "from_sdf" if sign < 0 else "from_occupancy"
    if isinstance(source, str | os.PathLike):
        path = existing_file(source)
        return path.name, read_network(path)
    if isinstance(source, torch.nn.Module) and source.training:
        unsteady = sorted({type(part).__name__ for part in source.modules() if isinstance(part, _UNSTEADY)})
        if unsteady:
            raise InputError(
                f"the network is in training mode and has {', '.join(unsteady)}, so its values depend on chance or on "
                "the other points of a batch: call .eval() on it first."
            )
    if not callable(source):
        raise InputError(
            f"{caller} got {type(source).__name__}; expected a callable on (N, 3) tensors or the path of a network. "
            "For values on a grid use topokit.from_voxels."
        )
    return ("sdf" if sign < 0 else "occupancy"), source


def _checked_bounds(bounds: Bounds) -> Bounds:
    try:
        corners = torch.tensor(bounds, dtype=torch.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"bounds could not be read ({error}); expected ((x0, y0, z0), (x1, y1, z1)).") from error
    if corners.shape != (2, 3) or not bool(corners.isfinite().all()) or not bool((corners[0] < corners[1]).all()):
        raise InputError(f"bounds must be ((x0, y0, z0), (x1, y1, z1)) with lower before upper, got {bounds}.")
    low, high = (tuple(corner) for corner in corners.tolist())
    return low, high


def _grown(function: LevelFunction) -> tuple[Corner, Corner, tuple[str, ...]]:
    """The smallest of the boxes [−2ᵏ, 2ᵏ]³ inside which the surface lies, or [−1, 1]³."""
    for doubling in range(_DOUBLINGS + 1):
        side = float(2**doubling)
        values = dense_grid(function.without_graph, (-side,) * 3, (side,) * 3, _LOOK).values
        touches = any(any(pair) for pair in reached_faces(values))
        if bool((values > 0).any()) and not touches:
            note = (f"The surface does not fit into [−1, 1]³; it was looked for in [−{side:g}, {side:g}]³.",)
            return (-side,) * 3, (side,) * 3, note if doubling else ()
    return (-1.0,) * 3, (1.0,) * 3, ()
