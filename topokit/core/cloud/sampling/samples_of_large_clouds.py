"""Samples of a cloud, from which tetrahedra are made: all points of a small one, few where a large one is flat."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.cloud.normals.creases import Faces
from topokit.core.cloud.normals.patches import Neighborhoods, refitted, turned_towards
from topokit.core.cloud.normals.propagation import Propagation
from topokit.core.cloud.sampling.cube_hierarchy import CubeHierarchy
from topokit.core.cloud.sampling.downsampling import representatives, thin_along_curve
from topokit.core.cloud.settings import CloudSettings


@dataclass(frozen=True, eq=False)
class Samples:
    """M samples of a cloud of N points.

    Attributes:
        kept: (M,), their indices in the cloud.
        owner: (N,), the sample that stands for each point.
        areas: (M,), surface area, summed over the points that a sample stands for.
        axes: (M, 3), unit normals of arbitrary sign that are better than planes through neighboring samples: given
            ones, or those found at a far higher density. None if there are none.
        signed: (M, 3), unit normals with signs carried along the surface; None if it is not smooth.
        parts: (M,), connected parts of the cloud.
        patches: (M,), pieces of the surface within which the carried signs agree.
        faces: the faces at creases, if the samples are all points.
    """

    kept: Integers
    owner: Integers
    areas: Floats
    axes: Floats | None
    signed: Floats | None
    parts: Integers
    patches: Integers
    faces: Faces | None

    @property
    def is_all(self) -> bool:
        """Whether all points are samples."""
        return len(self.kept) == len(self.owner)

    def refined(self, directions: Floats, local: Neighborhoods, settings: CloudSettings) -> Floats:
        """The normals (M, 3) that are known best, with the signs of directions (M, 3)."""
        if self.axes is not None:
            return turned_towards(self.axes, directions)
        normals = refitted(directions, local, settings.patches)
        return normals if self.faces is None else self.faces.sharpened(normals)

    def with_all_of(self, chosen: Booleans, points: Floats, most: int) -> tuple[Integers, Integers]:
        """These samples and the points that chosen ones (M,) of them stand for, at most so many in all.

        Returns:
            Indices in the cloud of points (N, 3), ascending, and the one of them that stands for each point (N,).
        """
        is_added = chosen[self.owner]
        is_added[self.kept] = False
        added = np.flatnonzero(is_added)
        added = added[thin_along_curve(points[added], most - len(self.kept))]
        kept = np.union1d(self.kept, added)
        owner = np.searchsorted(kept, self.kept)[self.owner]
        owner[kept] = np.arange(len(kept))
        return kept, owner

    def spread(self, normals: Floats, of_all: Floats) -> Floats:
        """Normals (N, 3) of all points with the signs of those of the samples (M, 3)."""
        if self.is_all:
            return normals
        flips = np.where((normals * of_all[self.kept]).sum(1) < 0, -1.0, 1.0)
        return of_all * flips[self.owner, None]


@dataclass(frozen=True, eq=False)
class Sampler:
    """Chooses samples of N points where features are small.

    Attributes:
        points: (N, 3).
        normals: (N, 3), unit, that tell opposite sheets apart; None if not known.
        areas: (N,), of the points.
        noise: standard deviation of the points from the surface.
        settings: see there.
    """

    points: Floats
    normals: Floats | None
    areas: Floats
    noise: float
    settings: CloudSettings

    @cached_property
    def _cubes(self) -> CubeHierarchy:
        most = self.settings.sampling.samples
        return CubeHierarchy(self.points, self.normals, largest=most, noise=self.noise)

    def chosen(self, budget: int) -> tuple[Integers, Integers]:
        """Indices (M,) of at most `budget` samples, and the one that stands for each point (N,)."""
        return representatives(self.points, self._cubes.cells(budget))

    def samples(
        self, axes: Floats | None = None, carried: Propagation | None = None, faces: Faces | None = None
    ) -> Samples:
        """All points, if they are few enough to be in one complex, else some of them.

        Args:
            axes: (N, 3), given unit normals of arbitrary sign.
            carried: signs carried along the surface.
            faces: at creases.
        """
        count = len(self.points)
        is_all = count <= self.settings.sampling.whole
        kept, owner = (np.arange(count), np.arange(count)) if is_all else self.chosen(self.settings.sampling.samples)
        signed = None if carried is None else carried.normals[kept]
        same = np.zeros(len(kept), dtype=np.int64)
        return Samples(
            kept=kept,
            owner=owner,
            areas=np.bincount(owner, self.areas).astype(np.float64),
            axes=axes[kept] if axes is not None else None if is_all else signed,
            signed=signed,
            parts=same if carried is None else carried.parts[kept],
            patches=same if carried is None else carried.patches[kept],
            faces=faces if is_all and axes is None else None,
        )
