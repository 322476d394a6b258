"""Planes that lie on a single face, where a point's own neighborhood mixes two.

Near a crease the plane of the nearest points is that of no face. One of the planes around fits both its own points and
this one, so its axis is that of the point's face.

Reference:
    J. Cao, H. Chen, J. Zhang, Y. Li, X. Liu, C. Zou, "Normal estimation via shifted neighborhood for point cloud",
    Journal of Computational and Applied Mathematics 329, 2018. Its candidates are weighed otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.cloud.normals.patches import Patches, Planes, in_blocks, turned_towards
from topokit.core.cloud.settings import CreaseSettings


@dataclass(frozen=True, eq=False)
class Faces:
    """The faces that points lie on, where these show better than in the points' own neighborhoods.

    Attributes:
        is_replaced: (N,), whether the plane of a narrower neighborhood fits far better than the point's own, as it does
            near creases.
        axes: (N, 3), unit normals of arbitrary sign of these planes.
        owner: (N,), the points whose neighborhoods they are of; elsewhere the point itself.
        show: whether neighborhoods are so flat that what is thicker is a crease rather than noise.
    """

    is_replaced: Booleans
    axes: Floats
    owner: Integers
    show: bool

    def sharpened(self, normals: Floats) -> Floats:
        """The normals (N, 3), near creases those of one face, with the sign that the normal has farther from it."""
        return np.where(self.is_replaced[:, None], turned_towards(self.axes, normals[self.owner]), normals)


def find_faces(patches: Patches, settings: CreaseSettings) -> Faces:
    """The faces at points near creases; none if neighborhoods are so thick that noise would pass for creases."""
    points, wide, own = patches.points, patches.planes, np.arange(len(patches.points))
    if np.median(wide.thickness / np.maximum(wide.sizes, 1e-300)) > settings.flat:
        return Faces(np.zeros(len(points), dtype=bool), wide.axes, own, show=False)
    narrow = _narrow_planes(points, patches.neighbors, settings)
    owner, misfit = own, narrow.misfit(points, own)
    for _ in range(settings.rounds):
        owner, misfit = _adopted(points, narrow, patches.neighbors, owner, misfit)
    is_better = misfit < settings.flatter * wide.misfit(points, own)
    return Faces(is_better, narrow.axes[owner], np.where(is_better, owner, own), show=True)


def _narrow_planes(points: Floats, neighbors: NDArray[np.integer], settings: CreaseSettings) -> Planes:
    planes = Planes.empty(len(points))

    def fit(rows: slice) -> None:
        planes.fit(rows, np.concatenate((points[rows, None], points[neighbors[rows, : settings.narrow]]), axis=1))

    in_blocks(fit, len(points))
    return planes


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
