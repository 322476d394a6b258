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

from topokit.core.cloud.axes import SurfaceAxes
from topokit.core.cloud.cubes import CubeHierarchy, curve_order
from topokit.core.cloud.downsampling import downsample, representatives, thin_along_curve
from topokit.core.cloud.planes import plane_axes, sharpened
from topokit.core.cloud.propagation import Propagation, propagate_signs

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_POINTS = 30_000
"""Clouds up to this size are used whole."""

SAMPLES = 20_000
"""Larger clouds are looked at through about so many samples, and for comparison through half as many."""

MORE_SAMPLES = 2 * SAMPLES
"""Where the votes of these differ, so many are looked at, if there are as many points."""

BOUNDARY_POINTS = 50_000
"""Boundaries are looked for, and curvature is summed, on at most so many points, evenly many along a curve."""

MOST_DENSE = 2_000_000
"""Of more points, evenly many along a curve are measured."""

_NOISY = 0.17  # thickness over radius of ten neighbors from which noise hides the surface: 0.4 spacings on a plane
_AVERAGED = (32, 64, 128, 256, 512)  # neighbors over which such noise may be averaged
_FLAT = 0.15  # thickness over radius below which a neighborhood shows its plane
_PROBES = 1000  # neighborhoods that decide how many neighbors are needed
_THINNER = 8  # points of a cloud per point of its thinner copy
_FEWEST_COPIED = 3_000  # points of the thinnest copy
_COPIED_PER_SAMPLE = 5  # points of a thinner copy per sample: samples nearer than that only repeat each other
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
        propagation: signs of these axes, near creases of those of the faces.
    """

    points: Floats
    surface: SurfaceAxes
    propagation: Propagation

    @cached_property
    def _hierarchy(self) -> CubeHierarchy:
        return self._cubes(SAMPLES)

    def _cubes(self, largest: int) -> CubeHierarchy:
        return CubeHierarchy(self.points, self.propagation.normals, largest=largest, noise=self.surface.noise)

    def samples(self, budget: int) -> Samples:
        """At most `budget` samples where features are small."""
        cubes = self._hierarchy if budget <= SAMPLES else self._cubes(budget)
        kept, owner = representatives(self.points, cubes.cells(budget))
        return Samples(kept, owner, np.bincount(owner, self.surface.areas).astype(np.float64))

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
        n_neighbors = min(int(np.ceil(np.pi * max(reach) ** 2)) * 2, len(self.points))
        index = np.empty((len(kept), n_neighbors), dtype=np.int64)
        order = curve_order(centers)[0]  # queries near each other are faster
        index[order] = self.surface.tree.query(centers[order], n_neighbors)[1]
        spacing = np.sqrt(self.surface.areas[kept])[:, None]
        own = normals[kept]
        way = self.points[index] - centers[:, None]
        height = np.einsum("nka,na->nk", way, own)
        sideways = np.einsum("nka,nka->nk", way, way) - height**2
        opposite = (np.einsum("nka,na->nk", normals[index], own) < -0.5) & (sideways < spacing**2)
        near = [(opposite & (np.abs(height) < one * spacing)).any(1) for one in reach]
        return tuple(float(areas[one].sum() / areas.sum()) for one in near)


def dense_cloud(points: Floats, surface: SurfaceAxes, axes: Floats | None = None) -> DenseCloud:
    """A cloud with signs carried along its surface.

    Args:
        points: (N, 3), distinct, centered.
        surface: their axes and areas.
        axes: (N, 3), unit normals of arbitrary sign, where known.
    """
    if axes is None:
        axes = sharpened(surface.axes, surface.faces)
    by_vote = surface.planes.show_creases
    return DenseCloud(points, surface, propagate_signs(points, axes, surface.areas, surface.neighbors, by_vote=by_vote))


def is_noisy(surface: SurfaceAxes) -> bool:
    """Whether neighborhoods at full density are about as thick as they are wide."""
    return surface.relative_thickness > _NOISY


def averaged(points: Floats, tree: cKDTree) -> tuple[Integers, Floats, bool]:
    """At most 30 000 evenly spread points of a noisy cloud, moved onto planes through many of its points.

    Where no neighborhood shows a plane, a thinner copy of the cloud is looked at instead: the noise is as large, but
    neighborhoods of as many points are wider.

    Returns:
        Indices (M,), positions (M, 3), and whether a thinner copy was needed.
    """
    copy, most = np.arange(len(points)), MOST_POINTS
    while True:
        kept, _ = downsample(points[copy], most, "even")
        own = points[copy[kept]]
        n_neighbors, is_plane = _neighbors_that_show_a_plane(own[:: max(len(kept) // _PROBES, 1)], tree)
        if is_plane or len(copy) < _THINNER * _FEWEST_COPIED:
            return copy[kept], _on_planes(own, tree, n_neighbors), len(copy) < len(points)
        copy = copy[thin_along_curve(points[copy], len(copy) // _THINNER)]
        tree, most = cKDTree(points[copy]), min(MOST_POINTS, len(copy) // _COPIED_PER_SAMPLE)


def _on_planes(own: Floats, tree: cKDTree, n_neighbors: int) -> Floats:
    moved = np.empty_like(own)
    for start in range(0, len(own), _ROWS):
        part = own[start : start + _ROWS]
        patch = tree.data[tree.query(part, n_neighbors)[1]]
        axes, _ = plane_axes(patch)
        moved[start : start + _ROWS] = part + axes * ((patch.mean(1) - part) * axes).sum(1, keepdims=True)
    return moved


def _neighbors_that_show_a_plane(centers: Floats, tree: cKDTree) -> tuple[int, bool]:
    """The fewest neighbors, in powers of two, of neighborhoods clearly wider than thick, and whether there are any."""
    for n_neighbors in _AVERAGED:
        distance, index = tree.query(centers, min(n_neighbors, tree.n))
        _, thickness = plane_axes(tree.data[index])
        if np.median(thickness / distance[:, -1]) < _FLAT:
            return n_neighbors, True
    return n_neighbors, False


def thinned(points: Floats) -> Integers:
    """Indices of the points that are measured: all, or two million evenly along a curve."""
    return thin_along_curve(points, MOST_DENSE)
