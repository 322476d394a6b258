"""The Euler characteristic of the union of balls around points, for all radii at once.

The union of balls of radius α has the homotopy type of the alpha complex: the Delaunay simplices whose value is at most
α. The value of a simplex is the radius of its smallest circumscribed sphere if that holds no other point (Gabriel), or
else the least value of the simplices that it bounds. χ(α) is then one cumulative sum over simplices sorted by value.

References:
    H. Edelsbrunner, E. P. Mücke, "Three-dimensional alpha shapes", ACM TOG 13(1), 1994, doi:10.1145/174462.156635.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from topokit.core.cloud.delaunay_cut import FACETS
from topokit.core.labels import connected_labels, count_distinct

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class AlphaComplex:
    """Delaunay simplices of N points with the radii from which they belong to the union of balls.

    Attributes:
        n_points: N.
        edges: (E, 2), vertex indices.
        edge_radii: (E,).
        facet_radii: (F,).
        facet_sides: (F, 2), tetrahedra on both sides; the number of tetrahedra stands for the outside of the hull.
        tetrahedron_radii: (T,).
    """

    n_points: int
    edges: Integers
    edge_radii: Floats
    facet_radii: Floats
    facet_sides: Integers
    tetrahedron_radii: Floats

    def euler_curve(self) -> tuple[Floats, Integers]:
        """Radii (M,), ascending, and the Euler characteristic (M,) of the union from each radius to the next."""
        radii = np.concatenate((self.edge_radii, self.facet_radii, self.tetrahedron_radii))
        signs = np.ones(len(radii), dtype=np.int64)
        signs[: len(self.edge_radii)] = signs[len(radii) - len(self.tetrahedron_radii) :] = -1
        order = np.argsort(radii, kind="stable")
        return radii[order], self.n_points + signs[order].cumsum()

    def parts(self, radius: float) -> tuple[Integers, int]:
        """The component (N,) of each point in the union of balls of one radius, and the number of its cavities."""
        joined = self.edges[self.edge_radii <= radius]
        component = connected_labels(self.n_points, joined[:, 0], joined[:, 1])
        count = len(self.tetrahedron_radii)
        free = np.append(self.tetrahedron_radii > radius, True)
        passage = self.facet_sides[self.facet_radii > radius]
        region = connected_labels(count + 1, passage[:, 0], passage[:, 1])
        return component, count_distinct(region[free]) - 1


def alpha_complex(points: Floats) -> AlphaComplex:
    """The alpha complexes of points for all radii, from their Delaunay tetrahedra.

    Args:
        points: (N, 3), in general position: not in a plane, no five on a sphere.
    """
    triangulation = Delaunay(points)
    tetrahedra, neighbors = triangulation.simplices.astype(np.int64), triangulation.neighbors.astype(np.int64)
    squared = _tetrahedron_values(points[tetrahedra])
    facets, facet_values, sides = _facet_values(points, tetrahedra, neighbors, squared)
    edges, edge_values = _edge_values(points, facets, facet_values)
    return AlphaComplex(len(points), edges, np.sqrt(edge_values), np.sqrt(facet_values), sides, np.sqrt(squared))


def _tetrahedron_values(corner: Floats) -> Floats:
    """Squared circumradii of (T, 4, 3) tetrahedra; infinite for flat ones."""
    a, b, c = (corner[:, k] - corner[:, 0] for k in (1, 2, 3))
    bc, ca, ab = np.cross(b, c), np.cross(c, a), np.cross(a, b)
    determinant = 2 * (a * bc).sum(1)
    numerator = (a * a).sum(1)[:, None] * bc + (b * b).sum(1)[:, None] * ca + (c * c).sum(1)[:, None] * ab
    is_solid = determinant != 0
    squared = (numerator * numerator).sum(1) / np.where(is_solid, determinant, 1.0) ** 2
    return np.where(is_solid, squared, np.inf)


def _facet_values(
    points: Floats, tetrahedra: Integers, neighbors: Integers, squared: Floats
) -> tuple[Integers, Floats, Integers]:
    """Every facet once: vertices (F, 3), squared radii (F,), and the tetrahedra on both sides (F, 2)."""
    count = len(tetrahedra)
    first, corner = np.nonzero((neighbors < 0) | (np.arange(count)[:, None] < neighbors))
    second = np.where(neighbors[first, corner] < 0, count, neighbors[first, corner])
    facets = tetrahedra[first[:, None], FACETS[corner]]
    center, radius = _circumcircles(points[facets])
    values = np.append(squared, np.inf)
    bound = np.minimum(values[first], values[second])
    across = np.append(neighbors, [[-1] * 4], axis=0)[second]
    opposite = (across == first[:, None]).argmax(1)
    apex = points[tetrahedra[first, corner]]
    other = points[np.append(tetrahedra, tetrahedra[:1], axis=0)[second, opposite]]
    is_full = ((apex - center) ** 2).sum(1) < radius
    is_full |= (((other - center) ** 2).sum(1) < radius) & (second < count)
    return facets, np.where(is_full, bound, np.minimum(radius, bound)), np.stack((first, second), 1)


def _circumcircles(corner: Floats) -> tuple[Floats, Floats]:
    """Centers (F, 3) and squared radii (F,) of the circumscribed circles of triangles (F, 3, 3)."""
    u, v = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    w = np.cross(u, v)
    size = 2 * (w * w).sum(1)
    way = (u * u).sum(1)[:, None] * np.cross(v, w) + (v * v).sum(1)[:, None] * np.cross(w, u)
    way /= np.where(size > 0, size, 1.0)[:, None]
    return corner[:, 0] + way, np.where(size > 0, (way * way).sum(1), np.inf)


def _edge_values(points: Floats, facets: Integers, facet_values: Floats) -> tuple[Integers, Floats]:
    """Every edge once, (E, 2), and its squared radius (E,)."""
    ordered, count = np.sort(facets, axis=1), len(points)
    keys = np.concatenate([ordered[:, a] * count + ordered[:, b] for a, b in ((0, 1), (0, 2), (1, 2))])
    opposite = np.concatenate([ordered[:, c] for c in (2, 1, 0)])
    order = np.argsort(keys, kind="stable")
    keys, opposite, values = keys[order], opposite[order], np.tile(facet_values, 3)[order]
    first = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
    ends = np.stack((keys // count, keys % count), 1)
    one, two = points[ends[:, 0]] - points[opposite], points[ends[:, 1]] - points[opposite]
    is_full = np.logical_or.reduceat((one * two).sum(1) < 0, first)
    bound = np.minimum.reduceat(values, first)
    edges = ends[first]
    half = ((points[edges[:, 0]] - points[edges[:, 1]]) ** 2).sum(1) / 4
    return edges, np.where(is_full, bound, np.minimum(half, bound))
