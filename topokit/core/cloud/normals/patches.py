"""Neighborhoods: one plane fit, the area and spacing of points, and the sheets that lie close together."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.cloud.settings import PatchSettings
from topokit.core.linalg import normalize, smallest_eigenvector
from topokit.core.neighbors import nearest_neighbors
from topokit.core.processors import n_cores
from topokit.errors import InputError

_ROWS = 1 << 12  # neighborhoods in memory, and in the processor's cache, at once
_FEWEST_ON_SHEET = 3  # neighbors on the same sheet that give an area
_PLACES = 100_000  # around which spacings are compared
_TINY = 1e-300  # keeps quotients of lengths finite


@dataclass(frozen=True, eq=False)
class Planes:
    """Planes fitted to the neighborhoods of N points.

    Attributes:
        centers: (N, 3), means of the neighborhoods.
        axes: (N, 3), unit normals of arbitrary sign.
        sizes: (N,), root-mean-square distances of the neighbors from the center.
        thickness: (N,), the same from the plane.
    """

    centers: Floats
    axes: Floats
    sizes: Floats
    thickness: Floats

    @classmethod
    def empty(cls, count: int) -> Planes:
        """Planes to be filled by `fit`."""
        return cls(np.empty((count, 3)), np.empty((count, 3)), np.empty(count), np.empty(count))

    def fit(self, rows: NDArray[np.integer] | slice, patches: Floats) -> None:
        """Set the planes of some points to those of patches (n, k, 3)."""
        center = patches.mean(1)
        self.centers[rows] = center
        self.axes[rows], self.thickness[rows] = plane_axes(patches)
        self.sizes[rows] = np.sqrt(((patches - center[:, None]) ** 2).sum((1, 2)) / patches.shape[1])

    def misfit(self, points: Floats, index: Integers) -> Floats:
        """Thickness of planes (...) and distance of points (..., 3) from them, over the planes' sizes."""
        height = np.einsum("...a,...a->...", points - self.centers[index], self.axes[index])
        return np.hypot(self.thickness[index], height) / np.maximum(self.sizes[index], _TINY)


def plane_axes(patches: Floats) -> tuple[Floats, Floats]:
    """Unit normals (n, 3) of arbitrary sign of planes fitted to patches (n, k, 3), and distances from them (n,)."""
    patches = patches - patches.mean(1, keepdims=True)
    moments = patches.transpose(0, 2, 1) @ patches
    size = np.maximum(np.trace(moments, axis1=1, axis2=2), np.finfo(np.float64).tiny)
    scaled = torch.from_numpy(moments / size[:, None, None])
    axes = smallest_eigenvector(scaled, scaled[:, 0]).numpy()
    height = np.einsum("nka,na->nk", patches, axes)
    return axes, np.sqrt(np.einsum("nk,nk->n", height, height) / patches.shape[1])


@dataclass(frozen=True, eq=False)
class Patches:
    """The neighborhoods of all N points of a cloud.

    Attributes:
        tree: of the points.
        around: (N, 10), neighbors, nearest first, without the point itself.
        planes: of these and the point.
        settings: numbers of neighbors.
    """

    tree: cKDTree
    around: NDArray[np.int32]
    planes: Planes
    settings: PatchSettings

    @property
    def points(self) -> Floats:
        """(N, 3)."""
        return np.asarray(self.tree.data)

    @cached_property
    def thickness(self) -> float:
        """Standard deviation of the points from the surface, at most: bending counts, too."""
        return float(np.median(self.planes.thickness))

    @property
    def neighbors(self) -> NDArray[np.int32]:
        """(N, 8), the neighbors that signs are carried to, nearest first."""
        return self.around[:, : self.settings.graph]

    def areas(self, normals: Floats | None = None) -> Floats:
        """The surface area (N,) that each point stands for: π r² / k of the disc that holds k neighbors, at most eight.

        Args:
            normals: (N, 3), unit; if given, only neighbors on the same sheet count.
        """
        if normals is None:
            return self._discs
        found, own = np.empty(len(self.points)), self.settings

        def measure(rows: slice) -> None:
            around = self.around[rows]
            squared = ((self.points[around] - self.points[rows, None]) ** 2).sum(2)
            is_near = np.einsum("nka,na->nk", normals[around], normals[rows]) > own.same_sheet
            is_near &= is_near.cumsum(1) <= own.graph
            k = is_near.sum(1)
            area = np.pi * np.where(is_near, squared, 0).max(1) / np.maximum(k, 1)
            found[rows] = np.where(k >= _FEWEST_ON_SHEET, area, np.nan)

        in_blocks(measure, len(found))
        unknown = np.isnan(found)
        if unknown.all():
            return self._discs
        found[unknown] = np.nanmedian(found) if unknown.any() else 0
        return found

    @cached_property
    def _discs(self) -> Floats:
        last = self.neighbors[:, -1]
        squared = ((self.points[last] - self.points) ** 2).sum(1)
        return np.asarray(np.pi * squared / self.neighbors.shape[1])

    @cached_property
    def spacing(self) -> float:
        """√(median area), the typical distance between neighboring points."""
        return float(np.sqrt(np.median(self._discs)))

    @cached_property
    def coarsest(self) -> float:
        """The spacing where the points are sparse: at one in a hundred places it is coarser."""
        around = self.around[:: -(-len(self.around) // _PLACES)]
        return float(np.quantile(np.sqrt(self._discs[around].mean(1)), 0.99))

    @property
    def roughness(self) -> float:
        """Median distance of neighbors from the local plane, in spacings."""
        return self.thickness / self.spacing


def patches_of(points: Floats, settings: PatchSettings) -> Patches:
    """The neighborhoods of all points; blocks of points on all processors, so memory is bounded.

    Args:
        points: (N, 3), distinct, more than ten.
        settings: numbers of neighbors.

    Raises:
        InputError: if most points coincide with others.
    """
    tree = cKDTree(points, balanced_tree=False)  # compact nodes pay where all points are looked up
    order = tree.indices  # neighboring queries share their way down the tree
    count = len(points)
    around, planes = np.empty((count, settings.plane), dtype=np.int32), Planes.empty(count)

    def measure(block: slice) -> None:
        rows = order[block]
        index = tree.query(points[rows], settings.plane + 1)[1]
        around[rows] = index[:, 1:]
        planes.fit(rows, points.take(index, axis=0))

    in_blocks(measure, count)
    found = Patches(tree, around, planes, settings)
    if not found.spacing > 0:
        raise InputError("most points coincide with others, so the sample spacing is zero: merge equal points first.")
    return found


@dataclass(frozen=True, eq=False)
class Neighborhoods:
    """The neighbors of M samples, among which opposite sheets are looked for.

    Attributes:
        points: (M, 3).
        index: (M, 40), the sample itself and its neighbors, nearest first; fewer columns for fewer samples.
        spacings: (M,), the typical distance between samples around each: √ of the mean area of 17 discs.
    """

    points: Floats
    index: Integers
    spacings: Floats

    @property
    def spacing(self) -> float:
        """The typical distance between neighboring samples."""
        return float(np.median(self.spacings))

    @property
    def finest(self) -> float:
        """The spacing where the samples are dense: one in ten has a finer one."""
        return float(np.quantile(self.spacings, 0.1))


def neighborhoods_of(points: Floats, settings: PatchSettings) -> Neighborhoods:
    """The neighborhoods of samples (M, 3) and their spacings; one neighbor query."""
    own = np.arange(len(points))[:, None]
    nearest = nearest_neighbors(torch.from_numpy(points), min(settings.wide, len(points) - 1)).numpy()
    index = np.concatenate((own, nearest), axis=1)
    rank = min(settings.graph, index.shape[1] - 1)
    discs = np.pi * ((points[index[:, rank]] - points) ** 2).sum(1) / rank
    around = discs[index[:, : settings.spacing + 1]].mean(1)
    return Neighborhoods(points, index, np.sqrt(np.maximum(around, 1e-6 * discs.mean())))


def in_blocks(act: Callable[[slice], None], count: int) -> None:
    """Act on all rows, in blocks on all processors."""
    with ThreadPoolExecutor(n_cores()) as threads:
        list(threads.map(lambda start: act(slice(start, start + _ROWS)), range(0, count, _ROWS)))


def unit(vectors: Floats) -> Floats:
    """Vectors (N, 3) scaled to length one; zero stays zero, and unit vectors are unchanged to the last digit."""
    is_unit = np.abs(np.linalg.norm(vectors, axis=1, keepdims=True) - 1) < 1e-9
    return np.where(is_unit, vectors, normalize(torch.from_numpy(vectors)).numpy())


def turned_towards(axes: Floats, directions: Floats) -> Floats:
    """The axes (N, 3), each turned towards its direction (N, 3)."""
    return np.where((axes * directions).sum(1, keepdims=True) < 0, -axes, axes)


def refitted(normals: Floats, local: Neighborhoods, settings: PatchSettings) -> Floats:
    """Normals of planes through the neighbors whose normals agree; where too few agree, the given normals.

    Args:
        normals: (M, 3), unit; they also give the sign.
        local: neighborhoods of the samples.
        settings: of the fit.
    """
    points, chosen = local.points, local.index[:, : settings.refit + 1]
    weight = _agreement(normals, chosen, settings)
    center = np.einsum("nk,nka->na", weight, points[chosen]) / np.maximum(weight.sum(1), 1e-12)[:, None]
    patch = points[chosen] - center[:, None]
    fitted = np.linalg.eigh(np.einsum("nk,nka,nkb->nab", weight, patch, patch))[1][:, :, 0]
    enough = (weight > 0.1).sum(1) >= settings.fewest_refitted
    return np.where(enough[:, None], turned_towards(fitted, normals), normals)


def flattened(normals: Floats, local: Neighborhoods, settings: PatchSettings) -> Floats:
    """Samples (M, 3) moved along their normals onto the plane of the neighbors that agree: one step of denoising."""
    points, chosen = local.points, local.index[:, : settings.refit + 1]
    weight = _agreement(normals, chosen, settings) + 1e-9
    center = np.einsum("nk,nka->na", weight, points[chosen]) / weight.sum(1, keepdims=True)
    return points + normals * ((center - points) * normals).sum(1, keepdims=True)


def _agreement(normals: Floats, index: Integers, settings: PatchSettings) -> Floats:
    """From 0 to 1, (M, k): how far the normals of neighbors agree with one's own."""
    cosine = (normals[index] * normals[:, None]).sum(2)
    return np.clip(cosine - settings.refit_cosine, 0, None) / (1 - settings.refit_cosine)


def opposite_neighbors(
    centers: Floats, own: Floats, points: Floats, normals: Floats, settings: PatchSettings
) -> tuple[Booleans, Floats, Floats]:
    """Which neighbors belong to an opposite sheet; height above the center, and squared distance sideways, (M, k).

    Args:
        centers: (M, 3).
        own: (M, 3), their unit normals.
        points: (M, k, 3), neighbors.
        normals: (M, k, 3), their unit normals.
        settings: of the cosine.
    """
    opposite = np.einsum("nka,na->nk", normals, own) < -settings.refit_cosine
    way = points - centers[:, None]
    height = np.einsum("nka,na->nk", way, own)
    return opposite, height, np.einsum("nka,nka->nk", way, way) - height**2
