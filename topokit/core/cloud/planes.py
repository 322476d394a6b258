"""Planes of neighborhoods, and the ones that lie on a single face where a point's own neighborhood mixes two.

Near a crease the plane of the nearest points is that of no face. Of the planes around there is one that its own points
and this one lie on, and so its axis is that of the point's face.

Reference:
    J. Cao, H. Chen, J. Zhang, Y. Li, X. Liu, C. Zou, "Normal estimation via shifted neighborhood for point cloud",
    Journal of Computational and Applied Mathematics 329, 2018. Its candidates are weighed otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from topokit.core.linalg import smallest_eigenvector
from topokit.core.processors import n_cores

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

WIDE = 10
"""Neighbors for a point's own plane: few, so that sheets that are close together are not mixed."""

_NARROW = 6  # neighbors for planes that near a crease lie on one face
_SHOWS_PLANES = 0.1  # median thickness over size up to which planes are compared: noise of a seventh of the spacing
_ROUNDS = 3  # each carries a plane one neighbor further
_FLATTER = 0.125  # share of the own misfit below which another plane is taken; between flat planes nothing is to be won
_ROWS = 1 << 12  # points whose candidates are in memory, and in the processor's cache, at once


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

    @property
    def show_creases(self) -> bool:
        """Whether neighborhoods are so flat that what is thicker is a crease rather than noise."""
        return bool(np.median(self.thickness / np.maximum(self.sizes, 1e-300)) <= _SHOWS_PLANES)

    def misfit(self, points: Floats, index: Integers) -> Floats:
        """Thickness of planes (...) and distance of points (..., 3) from them, over the planes' sizes."""
        height = np.einsum("...a,...a->...", points - self.centers[index], self.axes[index])
        return np.hypot(self.thickness[index], height) / np.maximum(self.sizes[index], 1e-300)


@dataclass(frozen=True, eq=False)
class Faces:
    """The faces that points lie on, where these show better than in the points' own neighborhoods.

    Attributes:
        is_replaced: (N,), whether the plane of a narrower neighborhood fits far better than the point's own, as it does
            near creases.
        axes: (N, 3), unit normals of arbitrary sign of these planes.
        owner: (N,), the points whose neighborhoods they are of; elsewhere the point itself.
    """

    is_replaced: Booleans
    axes: Floats
    owner: Integers

    def sharpened(self, normals: Floats) -> Floats:
        """The normals (N, 3), near creases those of one face, with the sign that the normal has farther from it."""
        return np.where(self.is_replaced[:, None], turned_towards(self.axes, normals[self.owner]), normals)


def find_faces(points: Floats, wide: Planes, neighbors: NDArray[np.integer]) -> Faces | None:
    """The faces at points near creases; None if neighborhoods are so thick that noise would pass for creases.

    Args:
        points: (N, 3).
        wide: the points' own planes.
        neighbors: (N, k), nearest first, without the point itself; the nearest few make the narrow neighborhoods.
    """
    if not wide.show_creases:
        return None
    own, narrow = np.arange(len(points)), _narrow_planes(points, neighbors)
    owner, misfit = own, narrow.misfit(points, own)
    for _ in range(_ROUNDS):
        owner, misfit = _adopted(points, narrow, neighbors, owner, misfit)
    is_better = misfit < _FLATTER * wide.misfit(points, own)
    return Faces(is_better, narrow.axes[owner], np.where(is_better, owner, own))


def _narrow_planes(points: Floats, neighbors: NDArray[np.integer]) -> Planes:
    planes = Planes.empty(len(points))

    def fit(rows: slice) -> None:
        planes.fit(rows, np.concatenate((points[rows, None], points[neighbors[rows, :_NARROW]]), axis=1))

    in_blocks(fit, len(points))
    return planes


def in_blocks(act: Callable[[slice], None], count: int) -> None:
    """Act on all rows, in blocks on all processors."""
    with ThreadPoolExecutor(n_cores()) as threads:
        list(threads.map(lambda start: act(slice(start, start + _ROWS)), range(0, count, _ROWS)))


def _adopted(
    points: Floats, planes: Planes, neighbors: NDArray[np.integer], owner: Integers, misfit: Floats
) -> tuple[Integers, Floats]:
    """The best of the planes of a point and its neighbors, and how badly it fits."""
    best, least = owner.copy(), misfit.copy()

    def adopt(rows: slice) -> None:
        candidates = owner[neighbors[rows]]
        fits = planes.misfit(points[rows, None], candidates)
        first = fits.argmin(1)[:, None]
        fit = np.take_along_axis(fits, first, 1)[:, 0]
        is_better = fit < least[rows]
        best[rows][is_better] = np.take_along_axis(candidates, first, 1)[is_better, 0]
        least[rows][is_better] = fit[is_better]

    in_blocks(adopt, len(points))
    return best, least


def plane_axes(patches: Floats) -> tuple[Floats, Floats]:
    """Unit normals (n, 3) of arbitrary sign of planes fitted to patches (n, k, 3), and distances from them (n,)."""
    patches = patches - patches.mean(1, keepdims=True)
    moments = patches.transpose(0, 2, 1) @ patches
    size = np.maximum(np.trace(moments, axis1=1, axis2=2), np.finfo(np.float64).tiny)
    scaled = torch.from_numpy(moments / size[:, None, None])
    axes = smallest_eigenvector(scaled, scaled[:, 0]).numpy()
    height = np.einsum("nka,na->nk", patches, axes)
    return axes, np.sqrt(np.einsum("nk,nk->n", height, height) / patches.shape[1])


def sharpened(normals: Floats, faces: Faces | None) -> Floats:
    """The normals (N, 3), near creases those of one face if faces are known; see `Faces.sharpened`."""
    return normals if faces is None else faces.sharpened(normals)


def turned_towards(axes: Floats, directions: Floats) -> Floats:
    """The axes (N, 3), each turned towards its direction (N, 3)."""
    return np.where((axes * directions).sum(1, keepdims=True) < 0, -axes, axes)
