"""Neighborhoods of samples: fitted planes, areas, noise and sheets that lie close together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.core.cloud.planes import WIDE, Faces, Planes, find_faces, turned_towards
from topokit.core.linalg import normalize
from topokit.core.neighbors import nearest_neighbors
from topokit.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_ROWS = 1 << 15  # samples whose neighborhoods are in memory at once
_NEAREST = 16  # neighbors for planes, areas and the comparison of normals
_WIDE = 39  # neighbors among which opposite sheets are looked for
_FLAT = 1e-6  # thickness of a cloud over its length up to which it lies in a plane
_OPPOSITE = -0.5  # cosine below which two normals belong to opposite sheets
_SAME_SHEET = 0.3  # cosine above which two normals belong to the same sheet
_DISC = 8  # neighbors of the disc whose area a sample stands for, and of the graph that planes are carried along
_FINEST = 0.1  # share of the samples whose spacing may be finer than the finest that is stated, and than a grid's cells
FEWEST_POINTS = 32
"""Smallest number of samples for which a solid is looked for."""


@dataclass(frozen=True, eq=False)
class LocalGeometry:
    """Neighborhoods of N samples.

    Attributes:
        points: (N, 3).
        index: (N, k + 1), the sample itself and its neighbors, nearest first.
        wide_index: (N, m), neighbors without the sample itself, nearest first, m ≥ k.
        distance: (N, k + 1), distances to `index`.
        normals: (N, 3), unit, of arbitrary sign: direction of least variance of the neighborhood (PCA).
        areas: (N,), surface area that each sample stands for.
        spacing: √(mean area), the typical distance between neighboring samples.
        spacings: (N,), the same around each sample: √(mean area of it and its neighbors).
        roughness: median distance of neighbors from the local plane, in spacings.
    """

    points: Floats
    index: Integers
    wide_index: Integers
    distance: Floats
    normals: Floats
    areas: Floats
    spacing: float
    spacings: Floats
    roughness: float

    @cached_property
    def faces(self) -> Faces | None:
        """The faces at creases; None if the samples are too noisy to tell."""
        planes = Planes.empty(len(self.points))
        planes.fit(slice(None), self.points[self.index[:, : WIDE + 1]])
        return find_faces(self.points, planes, self.index[:, 1 : _DISC + 1])


def local_geometry(points: Floats, areas: Floats | None = None, axes: Floats | None = None) -> LocalGeometry:
    """Neighborhoods, planes and areas of samples; one neighbor query.

    Args:
        points: (N, 3).
        areas: (N,), where known; π r₈² / 8 by default, r₈ the distance to the eighth neighbor.
        axes: (N, 3), unit normals of arbitrary sign, where known; fitted to the neighbors by default.

    Raises:
        InputError: if there are fewer than four points, or nearly all of them coincide.
    """
    wide_index = nearest_neighbors(torch.from_numpy(points), min(_WIDE, len(points) - 1)).numpy()
    own = np.arange(len(points))[:, None]
    index = np.concatenate((own, wide_index[:, :_NEAREST]), axis=1)
    distance = np.linalg.norm(points[index] - points[:, None], axis=2)
    normals, thickness = fit_planes(points, index)
    discs = _discs(distance)
    areas = discs if areas is None else areas
    spacing = float(np.sqrt(areas.mean()))
    if not spacing > 0:
        raise InputError("most points coincide with others, so the sample spacing is zero: merge equal points first.")
    roughness = float(np.median(thickness)) / spacing
    spacings = _spacings_around(discs, index, spacing)
    normals = normals if axes is None else axes
    return LocalGeometry(points, index, wide_index, distance, normals, areas, spacing, spacings, roughness)


def local_spacings(points: Floats) -> Floats:
    """The typical distance (N,) between samples around each of N points (N, 3), as in `LocalGeometry`."""
    index = with_neighbors(points, min(_NEAREST, len(points) - 1))
    discs = _discs(np.linalg.norm(points[index] - points[:, None], axis=2))
    return _spacings_around(discs, index, float(np.sqrt(discs.mean())))


def typical_and_finest(spacings: Floats) -> tuple[float, float]:
    """The median of local spacings (N,), and the one below which few of them are."""
    return float(np.median(spacings)), float(np.quantile(spacings, _FINEST))


def _discs(distance: Floats) -> Floats:
    """π r₈² / 8, (N,), from the distances (N, k + 1) to a sample and its neighbors."""
    rank = min(_DISC, distance.shape[1] - 1)
    return np.asarray(np.pi * distance[:, rank] ** 2 / rank)


def _spacings_around(discs: Floats, index: Integers, spacing: float) -> Floats:
    return np.sqrt(np.maximum(discs[index].mean(1), 1e-6 * spacing**2))


def with_neighbors(points: Floats, n_neighbors: int) -> Integers:
    """Each point's own index and those of its neighbors, nearest first, (N, k + 1)."""
    own = np.arange(len(points))[:, None]
    return np.concatenate((own, nearest_neighbors(torch.from_numpy(points), n_neighbors).numpy()), axis=1)


def fit_planes(points: Floats, index: Integers) -> tuple[Floats, Floats]:
    """Unit normals (N, 3) of arbitrary sign, and root-mean-square distances from the fitted planes (N,).

    Args:
        points: (N, 3).
        index: (N, m), the neighborhoods; processed in blocks to bound memory.
    """
    normals, thickness = np.empty((len(index), 3)), np.empty(len(index))
    for start in range(0, len(index), _ROWS):
        rows = slice(start, start + _ROWS)
        patch = points[index[rows]]
        patch -= patch.mean(1, keepdims=True)
        eigenvalue, eigenvector = np.linalg.eigh(np.einsum("nka,nkb->nab", patch, patch))
        normals[rows] = eigenvector[:, :, 0]
        thickness[rows] = np.sqrt(np.maximum(eigenvalue[:, 0], 0) / index.shape[1])
    return normals, thickness


def thicknesses(points: Floats, tree: cKDTree, rows: Integers) -> Floats:
    """Distances of some points' sixteen neighbors from their planes (M,), as `LocalGeometry.roughness` has them.

    Args:
        points: (N, 3).
        tree: of the points.
        rows: (M,), which of them.
    """
    return fit_planes(points, tree.query(points[rows], _NEAREST + 1)[1])[1]


def centered_positions(points: Floats) -> tuple[Floats, float]:
    """Positions around the origin, in units of a power of two near the longest side of their box, and that unit.

    Single precision loses the shape's digits far from the origin. Whole units are subtracted, so a cloud around the
    origin is unchanged to the last digit.

    Args:
        points: (N, 3).

    Raises:
        InputError: for the wrong shape, fewer than 32 points, values that are not finite, or points that lie in a
            plane, on a line or in one place.
    """
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"a cloud has shape (N, 3), not {points.shape}.")
    if len(points) < FEWEST_POINTS:
        raise InputError(f"{len(points)} points are too few to bound a solid: at least {FEWEST_POINTS} are needed.")
    if not np.isfinite(points).all():
        raise InputError("some coordinates are not finite: remove those points.")
    low, high = points.min(0), points.max(0)
    longest = float((high - low).max())
    if not np.isfinite(longest) or longest <= 0:
        raise InputError("the points all coincide, or their extent overflows: they bound no solid.")
    unit_length = float(2.0 ** np.floor(np.log2(longest)))
    middle = np.round((low / 2 + high / 2) / unit_length) * unit_length
    positions = (points - middle) / unit_length
    if is_flat(positions):
        raise InputError("the points lie in a plane or on a line: they bound no solid.")
    return positions, unit_length


def is_flat(points: Floats) -> bool:
    """Whether points (N, 3) lie in a plane, on a line or in one place."""
    variance = np.linalg.eigvalsh(np.cov(points, rowvar=False))
    return bool(variance[0] <= _FLAT**2 * variance[2])


def unit(vectors: Floats) -> Floats:
    """Vectors (N, 3) scaled to length one; zero stays zero, and unit vectors are unchanged to the last digit."""
    is_unit = np.abs(np.linalg.norm(vectors, axis=1, keepdims=True) - 1) < 1e-9
    return np.where(is_unit, vectors, normalize(torch.from_numpy(vectors)).numpy())


def clean_normals(
    points: Floats, normals: Floats, index: Integers, n_neighbors: int = 12, least_cosine: float = 0.5
) -> Floats:
    """Normals of planes through the neighbors whose normals agree; where too few agree, the given normals.

    Args:
        points: (N, 3).
        normals: (N, 3), unit; they also give the sign.
        index: (N, k + 1), as in `LocalGeometry`.
        n_neighbors: number of neighbors used.
        least_cosine: between two normals that agree.
    """
    chosen = index[:, : n_neighbors + 1]
    weight = np.clip((normals[chosen] * normals[:, None]).sum(2) - least_cosine, 0, None) / (1 - least_cosine)
    center = np.einsum("nk,nka->na", weight, points[chosen]) / np.maximum(weight.sum(1), 1e-12)[:, None]
    patch = points[chosen] - center[:, None]
    fitted = np.linalg.eigh(np.einsum("nk,nka,nkb->nab", weight, patch, patch))[1][:, :, 0]
    return np.where(((weight > 0.1).sum(1) >= 5)[:, None], turned_towards(fitted, normals), normals)


def flatten(points: Floats, normals: Floats, local: LocalGeometry, n_neighbors: int = 12) -> Floats:
    """Samples (N, 3) moved along their normals onto the plane of the neighbors that agree: one step of denoising."""
    chosen = local.index[:, : n_neighbors + 1]
    weight = np.clip((normals[chosen] * normals[:, None]).sum(2) - 0.5, 0, None) + 1e-9
    center = np.einsum("nk,nka->na", weight, points[chosen]) / weight.sum(1, keepdims=True)
    return points + normals * ((center - points) * normals).sum(1, keepdims=True)


def project_to_planes(points: Floats, n_neighbors: int, rounds: int = 2) -> Floats:
    """Points (N, 3) moved onto the planes of wide neighborhoods, several times: strong denoising."""
    for _ in range(rounds):
        index = with_neighbors(points, n_neighbors)
        normals, _ = fit_planes(points, index)
        points = points + normals * ((points[index].mean(1) - points) * normals).sum(1, keepdims=True)
    return points


def compatible_areas(normals: Floats, local: LocalGeometry, wanted: int = 8) -> Floats:
    """Disc areas π r² / k over the first `wanted` neighbors on the same sheet (normals agree), (N,)."""
    agrees = (normals[local.index[:, 1:]] * normals[:, None]).sum(2) > _SAME_SHEET
    rank = agrees.cumsum(1)
    k = np.minimum(wanted, rank[:, -1])
    last = np.minimum((rank < k[:, None]).sum(1), agrees.shape[1] - 1) + 1
    area = np.pi * local.distance[np.arange(len(normals)), last] ** 2 / np.maximum(k, 1)
    is_good = k >= 3
    return np.where(is_good, area, np.median(area[is_good])) if is_good.any() else local.areas


def opposite_neighbors(points: Floats, normals: Floats, index: Integers) -> tuple[NDArray[np.bool_], Floats, Floats]:
    """Which neighbors (N, k) belong to an opposite sheet; height above the sample, and squared distance sideways."""
    opposite = (normals[index] * normals[:, None]).sum(2) < _OPPOSITE
    way = points[index] - points[:, None]
    height = (way * normals[:, None]).sum(2)
    return opposite, height, (way * way).sum(2) - height**2


def crowded_shares(
    points: Floats, normals: Floats, index: Integers, spacing: float, reach: Sequence[float]
) -> tuple[float, ...]:
    """Shares of samples with an opposite sheet, behind or in front, nearer than some multiples of the spacing.

    Where the share is not nearly zero, walls or gaps are thinner than the samples can resolve, and all settings may
    agree on a wrong integer.

    Args:
        points: (N, 3).
        normals: (N, 3), unit, outward.
        index: (N, k), nearest neighbors.
        spacing: typical distance between neighboring samples.
        reach: distances of the opposite sheet, in spacings; sideways it is less than one spacing away.
    """
    opposite, height, side = opposite_neighbors(points, normals, index)
    near = opposite & (side < spacing**2)
    return tuple(float((near & (np.abs(height) < one * spacing)).any(1).mean()) for one in reach)
