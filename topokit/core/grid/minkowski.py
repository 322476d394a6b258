"""Volume, surface area, mean breadth and χ of a solid on a grid: sums over its cubes of 2 × 2 × 2 voxels.

Crofton's formulas give the area from how often lines enter the solid, and the mean breadth from χ of its plane
sections, on average over all directions. Voxels are points of a lattice, which has lines in 13 directions and planes
with 13 normals within a cube. Each direction stands for those that are nearest to it, also where the spacing differs
along the axes.

References:
    J. Ohser, F. Mücklich, "Statistical Analysis of Microstructures in Materials Science", 2000 (counts of cubes).
    D. Legland, K. Kiêu, M.-F. Devaux, "Computation of Minkowski measures on 2D and 3D binary images", Image Analysis &
    Stereology 26, 2007, doi:10.5566/ias.v26.p83-92 (shares of directions).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import combinations, pairwise, product
from math import pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import SphericalVoronoi

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.grid.euler import check_connectivity
from topokit.core.grid.grid import Spacing

_CORNERS = np.array(list(product((0, 1), repeat=3)))  # of bit c of a code
_DIRECTIONS = np.array([way for way in product((-1, 0, 1), repeat=3) if way > (0, 0, 0)])
_INSIDE = np.arange(256)[:, None] >> np.arange(8) & 1 == 1


@dataclass(frozen=True)
class MinkowskiNumbers:
    """Minkowski numbers of a solid, in units of length.

    Attributes:
        volume: of its voxels.
        surface_area: of its surface.
        mean_breadth: distance of two parallel planes that hold the solid, on average over their directions, if it is
            convex; of any solid the integral of the mean curvature over 2π.
        euler: χ of the solid; of a box cut from a larger body Δχ.
    """

    volume: float
    surface_area: float
    mean_breadth: float
    euler: float

    @property
    def mean_curvature(self) -> float:
        """Integral of the mean curvature over the surface."""
        return 2 * pi * self.mean_breadth


def cube_counts(inside: Booleans) -> Integers:
    """How often each code occurs among the cubes of 2 × 2 × 2 voxels, (256,).

    Args:
        inside: (X, Y, Z), whether a voxel is in the solid. Nothing ends at the ends of the array: add layers of
            background where the solid ends, and the first layers once more where it is periodic.
    """
    counts = np.zeros(256, np.int64)
    for lower, upper in pairwise(map(_squares, inside)):
        counts += np.bincount((lower | upper << 4).ravel(), minlength=256)
    return counts


def _squares(layer: Booleans) -> NDArray[Any]:
    """The codes of the squares of 2 × 2 voxels of a layer."""
    bits = layer.view(np.uint8)
    return bits[:-1, :-1] | bits[:-1, 1:] << 1 | bits[1:, :-1] << 2 | bits[1:, 1:] << 3


def euler_of(counts: Integers, connectivity: int) -> float:
    """χ of a solid by `cube_counts`; a cell in the last layer of two cubes counts half in each.

    Args:
        counts: (256,).
        connectivity: 6 or 26, that of the solid. Of voxels and background χ is the same on a lattice without ends.
    """
    return float((counts if check_connectivity(connectivity) == 6 else counts[::-1]) @ _tables().euler)


def minkowski_numbers(counts: Integers, connectivity: int, spacing: Spacing) -> MinkowskiNumbers:
    """The Minkowski numbers of a solid by `cube_counts`.

    Of balls with a radius of 10 cubic voxels or more, area and mean breadth are within 1 %. Faces along the axes are
    the worst case, 7 to 10 % too small.

    Args:
        counts: (256,).
        connectivity: 6 or 26, that of the solid and of its plane sections (4 or 8).
        spacing: step along each axis.
    """
    tables, steps = _tables(), np.asarray(spacing, float)
    sections = counts @ tables.sections if connectivity == 6 else -(counts[::-1] @ tables.sections)
    lines, normals = _DIRECTIONS * steps, _DIRECTIONS / steps
    voxel = float(steps.prod())
    return MinkowskiNumbers(
        volume=voxel * float(counts @ _INSIDE.sum(1)) / 8,
        surface_area=2 * voxel * float(counts @ tables.crossings @ (_shares(lines) / np.linalg.norm(lines, axis=1))),
        mean_breadth=float(sections @ (_shares(normals) / np.linalg.norm(normals, axis=1))),
        euler=euler_of(counts, connectivity),
    )


def _shares(directions: Floats) -> Floats:
    """The share of all directions that are nearest to each of some (N, 3), forth or back."""
    units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    areas = SphericalVoronoi(np.concatenate((units, -units))).calculate_areas()
    return areas.reshape(2, -1).sum(0) / (4 * pi)


class _Tables(NamedTuple):
    """What a cube of each code adds, the 6-connected phase being inside.

    Attributes:
        crossings: (256, 13) crossings of the surface by lines of each direction.
        sections: (256, 13) χ of the sections by planes with each normal.
        euler: (256,) χ.
    """

    crossings: Floats
    sections: Floats
    euler: Floats


@cache
def _tables() -> _Tables:
    """The tables; what belongs to several cubes counts in each by its share."""
    crossings = np.stack([_crossings(way) for way in _DIRECTIONS], axis=1)
    sections = np.stack([_sections(normal) for normal in _DIRECTIONS], axis=1)
    edges, squares = np.zeros((2, 256))
    for way in np.eye(3, dtype=int):
        edges += sum(_INSIDE[:, pair].all(1) for pair in _pairs(way)) / 4
        squares += sum(_INSIDE[:, square].all(1) for square in _polygons(way)) / 2
    return _Tables(crossings, sections, _INSIDE.sum(1) / 8 - edges + squares - _INSIDE.all(1))


def _crossings(way: Integers) -> Floats:
    pairs = _pairs(way)
    return np.mean([_INSIDE[:, one] != _INSIDE[:, other] for one, other in pairs], axis=0)  # in as many cubes as pairs


def _sections(normal: Integers) -> Floats:
    """χ of the polygons of a cube across a normal: of corners, less those of sides, and of polygons."""
    total = np.zeros(256)
    for polygon in _polygons(normal):
        n, middle = len(polygon), _CORNERS[polygon].sum(0) / 2
        sides = [pair for pair in combinations(polygon, 2) if (_CORNERS[list(pair)].sum(0) != middle).any()]
        total += _INSIDE[:, polygon].sum(1) * (n - 2) / (2 * n)  # 6 triangles or 4 rectangles meet at a corner
        total += _INSIDE[:, polygon].all(1) - sum(_INSIDE[:, side].all(1) for side in sides) / 2
    return total / (2 if np.abs(normal).sum() == 1 else 1)  # faces belong to two cubes


def _pairs(way: Integers) -> list[list[int]]:
    """The pairs of corners of a cube in a direction."""
    return [[a, b] for a, b in product(range(8), repeat=2) if (_CORNERS[b] - _CORNERS[a] == way).all()]


def _polygons(normal: Integers) -> list[list[int]]:
    """The triangles or rectangles of corners of a cube across a normal."""
    heights = _CORNERS @ normal
    groups = [np.flatnonzero(heights == height).tolist() for height in np.unique(heights)]
    return [group for group in groups if len(group) > 2]
