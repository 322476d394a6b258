"""The solid that cannot be seen into from outside, and how far its integer depends on the scale at which one looks.

Where Gaussians were optimized until views match, few of them are clean discs on the surface, but together they stop
light as the surface does. What lies behind so much extinction on every path is inside. Cavities and closed passages are
filled, since nobody sees them. One reading is made for each step of the grid, with and without closing gaps of a cell,
and for each depth that is called opaque.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from scipy import ndimage
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.arrays import Booleans, Floats
from topokit.core.grid.euler import surface_euler
from topokit.core.grid.grid import Grid
from topokit.core.grid.level_surface import level_surface
from topokit.core.opacity.depth import least_depth
from topokit.core.opacity.extinction import REACH, extinction
from topokit.core.processors import one_thread
from topokit.core.surface import TriangleSurface

OPAQUE = math.log(2)  # optical depth: half of the light is absorbed

_DEPTHS = (OPAQUE / 2, OPAQUE)  # from which a place is hidden: 30 and 50 % of the light
_DEEPEST = 2 * OPAQUE  # to which light is followed
_STEPS = (0.7, 0.5)  # of grids, in spacings of the Gaussians
_CLOSINGS = (0.0, 1.0)  # cells by which walls are thickened before light enters: gaps twice as wide are closed
_MOST_VERTICES = 200**3  # of a grid; what is larger gets larger cells
_NEIGHBORS = 8  # of each Gaussian, which tell the spacing
_PROBES = 20_000  # Gaussians whose spacing is measured
_HIDDEN = 2.0  # spacings below the surface from which a disc is no part of it
_FINEST = 4.0  # cells: no resolution is better, where discs lie a cell inside and gaps of two cells are closed
_NARROWEST = 2.5  # spacings: pieces smaller than a ball so wide are specks


class Gaussians(NamedTuple):
    """N Gaussians that absorb light.

    Attributes:
        means: (N, 3), in units of length.
        covariances: (N, 3, 3), in squared units; a disc may have no thickness.
        integrals: (N,), optical depth through the middle times area.
        is_disc: (N,) bool, whether it is flat, so that it shows where a surface is. If most are not, all do.
    """

    means: Tensor
    covariances: Tensor
    integrals: Tensor
    is_disc: Tensor

    def extinction(self, grid: Grid) -> Tensor:
        """The extinction on a grid (X, Y, Z), Gaussians smoothed over a cell: none falls between vertices."""
        smoothing = grid.cell**2 * torch.eye(3, dtype=torch.float64)
        return extinction(self.means, self.covariances.double().cpu() + smoothing, self.integrals, grid)


@dataclass(frozen=True, eq=False)
class OpacityReading:
    """What opacity says about a solid.

    Attributes:
        eulers: χ of its surface in every reading, with both connectivities.
        euler: the one seen most often, of several the nearest to zero.
        share: of the readings that give it.
        hidden: share of the discs (of all Gaussians, if most are no discs) that lie inside, two spacings or more from
            the surface. They are walls of cavities and passages that cannot be seen, which this solid lacks.
        surface: of the finest grid that shows `euler` in both connectivities; None if none does.
        seconds: time that it took.
        resolution: width of the narrowest feature that can be seen, in units of length: the surface lies before the
            discs, by a median depth, on both sides of a gap, and gaps of two cells are closed.
    """

    eulers: tuple[int, ...]
    euler: int
    share: float
    hidden: float
    surface: TriangleSurface | None
    resolution: float
    seconds: float


class _Solid(NamedTuple):
    """One reading: values (X, Y, Z), positive inside, and χ of the surface with 6- and 26-connected solid."""

    values: Floats
    grid: Grid
    eulers: tuple[int, int]


@one_thread()
@torch.no_grad()
def read_opacity(gaussians: Gaussians, finer_than: float | None = None) -> OpacityReading | None:
    """The solid that cannot be seen into, by all readings; None if light passes through all that is there.

    Runs on the CPU, is deterministic, and is not differentiable.

    Args:
        gaussians: of a scene.
        finer_than: width in units of length; if features so narrow surely cannot be seen, nothing is read.
    """
    started = time.perf_counter()
    gaussians, unit, center = _in_unit_box(gaussians)
    spacing = typical_spacing(gaussians.means)
    grids = _grids(gaussians.means, spacing)
    if finer_than is not None and _FINEST * grids[-1].cell * unit > finer_than:
        return None
    solids = [one for grid in grids for one in _solids(gaussians, grid, spacing)]
    if not all((one.values > 0).any() for one in solids):
        return None
    eulers = tuple(euler for one in solids for euler in one.eulers)
    tally = Counter(eulers)
    euler = max(tally, key=lambda value: (tally[value], -abs(value)))
    showing = [one for one in solids if one.eulers == (euler, euler)]
    shown = min(showing, key=lambda one: one.grid.cell, default=solids[-1])
    flat = gaussians.is_disc
    below = _depths_below(shown, gaussians.means[flat] if 2 * int(flat.sum()) >= len(flat) else gaussians.means)
    return OpacityReading(
        eulers=eulers,
        euler=euler,
        share=tally[euler] / len(eulers),
        hidden=float((below > _HIDDEN * spacing).mean()),
        surface=_surface(shown, unit, center) if showing else None,
        resolution=unit * 2 * (float(np.median(below)) + shown.grid.cell),
        seconds=time.perf_counter() - started,
    )


def _in_unit_box(gaussians: Gaussians) -> tuple[Gaussians, float, Tensor]:
    """The Gaussians in a unit in which they are about one wide around the origin, that unit, and where this was."""
    means = gaussians.means.double().cpu()
    low, high = means.amin(0), means.amax(0)
    unit, center = float((high - low).max()) or 1.0, low + (high - low) / 2
    covariances, integrals = (part.double().cpu() / unit / unit for part in gaussians[1:3])
    return Gaussians((means - center) / unit, covariances, integrals, gaussians.is_disc.cpu()), unit, center


def _surface(solid: _Solid, unit: float, center: Tensor) -> TriangleSurface:
    found = level_surface(torch.from_numpy(solid.values), solid.grid, 6)
    return TriangleSurface(unit * found.vertices + center.numpy(), found.faces)


def typical_spacing(means: Tensor) -> float:
    """The median over points (N, 3) of the spacing at which their eight neighbors would cover a disc evenly."""
    points = means.detach().double().cpu().numpy()
    k = min(_NEIGHBORS, len(points) - 1)
    probes = points[:: max(len(points) // _PROBES, 1)]
    reach = cKDTree(points).query(probes, k + 1)[0][:, -1]
    return float(np.median(reach)) * math.sqrt(math.pi / k)


def grid_around(means: Tensor, step: float) -> Grid:
    """A grid of cubes with a margin of seven steps around points (N, 3).

    The step is larger where the grid would have too many vertices.
    """
    points = means.detach().double().cpu()
    low, high = points.amin(0), points.amax(0)
    smallest = float((high - low).max()) / _MOST_VERTICES  # of a line of points; growing by shares, whatever was asked
    while True:
        one = max(step, smallest)
        margin = (2 * REACH + 1) * one
        x, y, z = (int(cells) + 2 for cells in ((high - low + 2 * margin) / one).tolist())
        if x * y * z <= _MOST_VERTICES:
            a, b, c = (low - margin).tolist()
            return Grid((x, y, z), (one, one, one), (a, b, c))
        smallest *= 1.02


def _grids(means: Tensor, spacing: float) -> list[Grid]:
    """One for each step, coarsest first; one alone where all would have too many vertices."""
    return list(dict.fromkeys(grid_around(means, step * spacing) for step in _STEPS))


def _solids(gaussians: Gaussians, grid: Grid, spacing: float) -> Iterator[_Solid]:
    speck = math.pi / 6 * (_NARROWEST * spacing / grid.cell) ** 3  # voxels
    walls = gaussians.extinction(grid)
    for closing in _CLOSINGS:
        if closing:
            walls = torch.from_numpy(ndimage.grey_dilation(walls.numpy(), footprint=_ball(closing)))
        depth = least_depth(walls, grid.cell, _DEEPEST).numpy()
        for level in _DEPTHS:
            values = depth - level
            if closing:  # light that has come as far as the thickened walls let it goes on to the walls themselves
                values = np.where(ndimage.binary_erosion(values > 0, _ball(closing)), 1.0, -1.0)
            values[_specks(values > 0, speck)] = -1.0
            found = torch.from_numpy(values)
            yield _Solid(values, grid, (int(surface_euler(found, 0.0, 6)), int(surface_euler(found, 0.0, 26))))


def _specks(inside: Booleans, smallest: float) -> Booleans:
    """The voxels of pieces with fewer voxels than `smallest`."""
    labels = ndimage.label(inside)[0]
    sizes = np.bincount(labels.ravel())
    return inside & (sizes < smallest)[labels]


def _depths_below(solid: _Solid, points: Tensor) -> Floats:
    """How far inside the surface points (N, 3) lie, in units of length; 0 for those outside."""
    depth = ndimage.distance_transform_edt(solid.values > 0) * solid.grid.cell
    steps = (points.double().cpu().numpy() - np.array(solid.grid.origin)) / solid.grid.cell
    x, y, z = np.rint(steps).astype(np.int64).T
    found: Floats = depth[x, y, z]
    return found


def _ball(radius: float) -> Booleans:
    """The offsets that are no longer than a radius, as a footprint."""
    reach = int(radius)
    offsets = np.mgrid[-reach : reach + 1, -reach : reach + 1, -reach : reach + 1]
    found: Booleans = (offsets**2).sum(0) <= radius**2
    return found
