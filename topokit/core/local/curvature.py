"""Curvature and area element of surface samples from their nearest neighbors."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral
from typing import Literal, TypedDict, get_args

import torch
from torch import Tensor

from topokit.core.linalg import determinant, eigenvalues, eigenvectors, normalize, tangent_basis, trace
from topokit.core.local.chunks import in_chunks
from topokit.core.local.frames import normals_from_neighbors
from topokit.core.local.quadric import fit_quadrics
from topokit.core.local.voronoi import AreaMethod, cell_areas
from topokit.core.local.weingarten import Solver, weingarten_map
from topokit.core.neighbors import merged_neighbors, nearest_neighbors
from topokit.core.precision import full_precision
from topokit.core.samples import SurfaceSamples, enough_neighbors
from topokit.errors import InputError

NormalMethod = Literal["pca", "quadric"]

DEFAULT_NEIGHBORS = 20
"""Number of neighbors on clean samples, and of the boundary behind a verdict."""

CELL_NEIGHBORS = 48  # the nearest, among which a Voronoi cell is found; it has six sides on average, rarely twelve


@dataclass(frozen=True)
class CurvatureSettings:
    """How curvature and area are estimated from a neighborhood.

    Attributes:
        n_neighbors: k, number of nearest neighbors; more smooths more.
        normal_method: how normals are estimated where the samples have none. "pca" is the paper's plane of least
            spread; "quadric", the default, the normal of a quadric fitted over it, which curvature does not tilt where
            a neighborhood is lopsided.
        solver: least-squares method for the Weingarten map, see `weingarten_map`.
        area_method: Voronoi cells "exact" or by "monte-carlo", see `cell_areas`; unused where the samples bring areas.
        area_resolution: points per side of the Monte Carlo grid.
    """

    n_neighbors: int = DEFAULT_NEIGHBORS
    solver: Solver = "sylvester"
    area_method: AreaMethod = "exact"
    area_resolution: int = 32
    normal_method: NormalMethod = "quadric"

    def __post_init__(self) -> None:
        enough_neighbors(self.n_neighbors)
        if not isinstance(self.area_resolution, Integral) or self.area_resolution < 2:
            raise InputError(f"area_resolution is {self.area_resolution!r}; an integer of at least 2 is needed.")
        if self.normal_method not in get_args(NormalMethod):
            raise InputError(f"normal method {self.normal_method!r} is unknown; use 'pca' or 'quadric'.")


DEFAULT_SETTINGS = CurvatureSettings()


class CurvatureMethods(TypedDict, total=False):
    """`CurvatureSettings` but for the number of neighbors, as keyword arguments."""

    solver: Solver
    area_method: AreaMethod
    area_resolution: int
    normal_method: NormalMethod


@dataclass(frozen=True, eq=False)
class Curvature:
    """Curvature and area element at N samples; all floating-point tensors are differentiable.

    Attributes:
        gaussian: K = det W, (..., N), in 1/length². Rows of padding have area 0, and nothing else of meaning.
        mean: H = ½ tr W, (..., N), in 1/length; positive where the surface bends towards its inside (sphere of radius
            r: 1/r). Its sign is that of the normals and is arbitrary where those are not oriented.
        total: F = tr(WᵀW), (..., N), in 1/length²; κ₁² + κ₂² for a symmetric W. This is the paper's total curvature,
            not the integral ∫ K dA that differential geometry calls by that name.
        principal: (..., N, 2), κ_min then κ_max, eigenvalues of the symmetric part of W.
        directions: (..., N, 2, 3), unit vectors belonging to `principal`; signs are arbitrary, and so is the whole
            tangent basis at umbilics.
        area: (..., N), tangent Voronoi areas (or the samples' own `areas`), in length².
        normals: (..., N, 3), unit.
        is_boundary: (..., N) bool, True where the Voronoi cell is open on one side.
        neighbors: (..., N, k) int64, nearest first; indices into the same batch item's points.
    """

    gaussian: Tensor
    mean: Tensor
    total: Tensor
    principal: Tensor
    directions: Tensor
    area: Tensor
    normals: Tensor
    is_boundary: Tensor
    neighbors: Tensor


@full_precision
def surface_curvature(
    samples: SurfaceSamples, settings: CurvatureSettings = DEFAULT_SETTINGS, *, neighbors: Tensor | None = None
) -> Curvature:
    """Curvature and area element at every sample (Algorithm 2, steps 2 to 6).

    Neighbors more than 45° above the tangent plane are left out, because they lie on another sheet. The paper keeps
    them; on thin parts that halves the area.

    Args:
        samples: N points, with normals or frames if they are known.
        settings: number of neighbors and methods.
        neighbors: (..., N, k) indices from an earlier call, nearest first; they are searched otherwise. Rows of padding
            must hold their own index.

    Returns:
        `Curvature`, differentiable in points, normals, frames and areas at fixed neighbor indices: values jump where a
        step changes the neighbors. Forward mode (`torch.func.jvp`) and second derivatives are exact as well;
        `torch.compile(fullgraph=True)` works if the neighbors are given. `torch.func.vmap` works where no values are
        looked at: on accelerators, and in `topokit.testing.as_on_accelerator`; batches need no vmap.

    Raises:
        InputError: if there are too few points, or for an unknown method.
    """
    if neighbors is None:
        neighbors = nearest_neighbors(samples.points, settings.n_neighbors, lengths=samples.lengths)
    samples = samples.without_values_in_padding()
    flat, merged = samples.flat(), merged_neighbors(neighbors)
    normals = _unit_normals(flat, merged, settings.normal_method)

    def local(rows: Tensor) -> tuple[Tensor, ...]:
        offsets = at_neighbors(flat.points, merged, rows) - flat.points[rows].unsqueeze(-2)  # (m, k, 3)
        frames = tangent_basis(normals[rows], offsets[:, -1]) if flat.frames is None else flat.frames[rows]
        tangent, same_sheet = tangent_neighbors(offsets, frames)
        around = at_neighbors(normals, merged, rows) @ frames.mT  # (m, k, 3), in the frame of the center
        change = around[..., :2] * same_sheet  # the center's own normal is (0, 0, 1) there
        if not samples.oriented:  # take whichever sign of the neighbor's normal is closer
            change = torch.where(around[..., 2:] < 0, -change, change)
        tangent = tangent * same_sheet
        shape_operator = weingarten_map(tangent, change, settings.solver)
        symmetric = (shape_operator + shape_operator.mT) / 2
        areas, is_open = cell_areas(tangent[:, :CELL_NEIGHBORS], settings.area_method, settings.area_resolution)
        return shape_operator, eigenvalues(symmetric), eigenvectors(symmetric) @ frames[:, :2], areas, is_open

    shape_operator, principal, directions, areas, is_open = in_chunks(
        local, len(merged), merged.device, merged.shape[1]
    )
    lead = samples.points.shape[:-1]
    return Curvature(
        gaussian=determinant(shape_operator).reshape(lead),
        mean=trace(shape_operator).reshape(lead) / 2,
        total=shape_operator.square().sum((-2, -1)).reshape(lead),
        principal=principal.reshape(*lead, 2),
        directions=directions.reshape(*lead, 2, 3),
        area=areas.reshape(lead) if samples.areas is None else samples.areas,
        normals=normals.reshape(*lead, 3),
        is_boundary=is_open.reshape(lead),
        neighbors=neighbors,
    )


def at_neighbors(values: Tensor, neighbors: Tensor, rows: Tensor) -> Tensor:
    """Values (N, d) at the neighbors (N, k) of some rows (m,), as (m, k, d); several times faster than indexing."""
    index = neighbors[rows]
    return values.index_select(0, index.flatten()).reshape(*index.shape, -1)


def tangent_neighbors(offsets: Tensor, frames: Tensor) -> tuple[Tensor, Tensor]:
    """Neighbors projected to the tangent plane, and whether they lie on the same sheet of the surface.

    Args:
        offsets: (..., k, 3), neighbors minus center.
        frames: (..., 3, 3), rows t, t', n.

    Returns:
        tangent coordinates (..., k, 2), and (..., k, 1) bool, True for neighbors at most 45° above the tangent plane.
    """
    coordinates = offsets @ frames.mT
    x, y, height = coordinates.detach().split(1, dim=-1)
    return coordinates[..., :2], height * height <= x * x + y * y


def _unit_normals(flat: SurfaceSamples, neighbors: Tensor, method: NormalMethod) -> Tensor:
    """Unit normals (B·N, 3): those of the samples, or estimated."""
    known = flat.known_normals()
    if known is not None:
        return known if flat.frames is not None else normalize(known)

    def local(rows: Tensor) -> tuple[Tensor]:
        offsets = at_neighbors(flat.points, neighbors, rows) - flat.points[rows].unsqueeze(-2)
        return (normals_from_neighbors(offsets) if method == "pca" else fit_quadrics(offsets).normals(),)

    return in_chunks(local, len(neighbors), neighbors.device, neighbors.shape[1])[0]
