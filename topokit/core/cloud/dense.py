"""A large cloud: normals and signs of all its points first, then samples where features are small.

At full density sheets are many spacings apart, so signs that are hard to tell on a few samples are easy to carry from
neighbor to neighbor. The samples are chosen afterwards, by how far each sheet is from flat.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.core.cloud.axes import SurfaceAxes, plane_axes
from topokit.core.cloud.cubes import CubeHierarchy
from topokit.core.cloud.downsampling import downsample, representatives, thin_along_curve
from topokit.core.cloud.propagation import Propagation, propagate_signs

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_POINTS = 30_000
"""Clouds up to this size are used whole."""

SAMPLES = 20_000
"""Larger clouds are looked at through about so many samples, and for comparison through half as many."""

BOUNDARY_POINTS = 50_000
"""Boundaries are looked for, and curvature is summed, on at most so many points, evenly many along a curve."""

MOST_DENSE = 2_000_000
"""Of more points, evenly many along a curve are measured."""

_NOISY = 0.17  # thickness over radius of ten neighbors from which noise hides the surface: 0.4 spacings on a plane
_AVERAGED = (32, 64, 128, 256, 512)  # neighbors over which such noise may be averaged
_FLAT = 0.15  # thickness over radius below which a neighborhood shows its plane
_PROBES = 1000  # neighborhoods that decide how many neighbors are needed
_ROWS = 1 << 11  # neighborhoods in memory at once


@dataclass(frozen=True, eq=False)
class Samples:
    """Some of the points of a dense cloud, and what stands for what.

    Attributes:
        kept: (M,), indices of the samples in the dense cloud.
        owner: (N,), the sample that stands for each point.
        areas: (M,), summed over the points that a sample stands for.
    """

    kept: Integers
    owner: Integers
    areas: Floats


@dataclass(frozen=True, eq=False)
class DenseCloud:
    """All points of a large cloud with their normals.

    Attributes:
        points: (N, 3).
        surface: their axes, areas and noise.
        propagation: signs of these axes along a spanning tree.
    """

    points: Floats
    surface: SurfaceAxes
    propagation: Propagation

    @cached_property
    def _hierarchy(self) -> CubeHierarchy:
        return CubeHierarchy(self.points, self.propagation.normals, largest=SAMPLES, noise=self.surface.noise)

    def samples(self, budget: int) -> Samples:
        """At most `budget` samples, at most `SAMPLES`, where features are small."""
        kept, owner = representatives(self.points, self._hierarchy.cells(budget))
        return Samples(kept, owner, np.bincount(owner, self.surface.areas).astype(np.float64))

    def disagreement(self, normals: Floats) -> float:
        """Share of neighbor pairs whose normals (N, 3) oppose each other."""
        opposed = [np.einsum("na,na->n", normals, normals[column]) < 0 for column in self.surface.neighbors.T]
        return float(np.mean([column.mean() for column in opposed]))

    def crowded_shares(
        self, samples: Samples, normals: Floats, reach: tuple[float, ...], most_samples: int = SAMPLES
    ) -> tuple[float, ...]:
        """Shares of the area with an opposite sheet nearer than some multiples of the spacing of all points.

        Args:
            samples: at which it is measured.
            normals: (N, 3), of all points.
            reach: distances of the opposite sheet, in local spacings; sideways it is less than one spacing away.
            most_samples: largest number of samples to measure at.
        """
        chosen = slice(None, None, -(-len(samples.kept) // most_samples))
        kept, areas = samples.kept[chosen], samples.areas[chosen]
        centers = self.points[kept]
        n_neighbors = int(np.ceil(np.pi * max(reach) ** 2)) * 2
        index = self.surface.tree.query(centers, min(n_neighbors, len(self.points)))[1]
        spacing = np.sqrt(self.surface.areas[kept])[:, None]
        own = normals[kept]
        way = self.points[index] - centers[:, None]
        height = np.einsum("nka,na->nk", way, own)
        sideways = np.einsum("nka,nka->nk", way, way) - height**2
        opposite = (np.einsum("nka,na->nk", normals[index], own) < -0.5) & (sideways < spacing**2)
        near = [(opposite & (np.abs(height) < one * spacing)).any(1) for one in reach]
        return tuple(float(areas[one].sum() / areas.sum()) for one in near)


def dense_cloud(points: Floats, surface: SurfaceAxes) -> DenseCloud:
    """A cloud with its signs carried along a spanning tree.

    Args:
        points: (N, 3), distinct, centered.
        surface: their axes and areas.
    """
    return DenseCloud(points, surface, propagate_signs(points, surface.axes, surface.areas, surface.neighbors))


def is_noisy(surface: SurfaceAxes) -> bool:
    """Whether neighborhoods at full density are about as thick as they are wide."""
    return surface.roughness > _NOISY


def averaged(points: Floats, tree: cKDTree) -> tuple[Integers, Floats]:
    """About 30 000 evenly spread points of a noisy cloud, moved onto planes through many of all its points.

    Returns:
        Indices (M,), and positions (M, 3).
    """
    kept, _ = downsample(points, MOST_POINTS, "even")
    n_neighbors = _neighbors_that_show_a_plane(points[kept[:: max(len(kept) // _PROBES, 1)]], tree)
    moved = np.empty((len(kept), 3))
    for start in range(0, len(kept), _ROWS):
        own = points[kept[start : start + _ROWS]]
        patch = points[tree.query(own, n_neighbors)[1]]
        axes, _ = plane_axes(patch)
        moved[start : start + _ROWS] = own + axes * ((patch.mean(1) - own) * axes).sum(1, keepdims=True)
    return kept, moved


def _neighbors_that_show_a_plane(centers: Floats, tree: cKDTree) -> int:
    """The fewest neighbors, in powers of two, whose neighborhoods are clearly wider than thick."""
    for n_neighbors in _AVERAGED:
        distance, index = tree.query(centers, min(n_neighbors, tree.n))
        _, thickness = plane_axes(tree.data[index])
        if np.median(thickness / distance[:, -1]) < _FLAT:
            break
    return n_neighbors


def thinned(points: Floats) -> Integers:
    """Indices of the points that are measured: all, or two million evenly along a curve."""
    return thin_along_curve(points, MOST_DENSE)
