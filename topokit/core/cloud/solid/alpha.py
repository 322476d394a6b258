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
from scipy.spatial import Delaunay

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.sampling.one_point_per_cell import in_order
from topokit.core.cloud.solid.columns import circumcenters, cross_columns, dot_columns, edges_of, facing_crosses
from topokit.core.cloud.solid.tetrahedra import facets_at
from topokit.core.labels import connected_labels, count_distinct

_DISPLACEMENT = 1e-4  # in spacings; points of a lattice have no unique tetrahedra


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

    def euler_weights(self, smallest: float, largest: float) -> tuple[Floats, Integers, Floats]:
        """Radii (M,) from the smallest to the largest, the Euler characteristic from each on, and how much that counts.

        Radii from a to b weigh 1 / a − 1 / b: small ones count more.
        """
        radii, eulers = self.euler_curve()
        start = np.clip(radii, smallest, largest)
        return start, eulers, 1 / start - 1 / np.append(start[1:], largest)

    def parts(self, radius: float) -> tuple[Integers, int]:
        """The component (N,) of each point in the union of balls of one radius, and the number of its cavities."""
        joined = self.edges[self.edge_radii <= radius]
        component = connected_labels(self.n_points, joined[:, 0], joined[:, 1])
        count = len(self.tetrahedron_radii)
        free = np.append(self.tetrahedron_radii > radius, True)
        passage = self.facet_sides[self.facet_radii > radius]
        region = connected_labels(count + 1, passage[:, 0], passage[:, 1])
        return component, count_distinct(region[free]) - 1


def union_of_balls(points: Floats, spacing: float) -> AlphaComplex:
    """The alpha complexes of points (N, 3) in any position: moved by a ten-thousandth of their spacing."""
    return alpha_complex(points + _DISPLACEMENT * spacing * np.random.default_rng(0).normal(size=points.shape))


def alpha_complex(points: Floats) -> AlphaComplex:
    """The alpha complexes of points for all radii, from their Delaunay tetrahedra.

    Args:
        points: (N, 3), in general position: not in a plane, no five on a sphere.
    """
    triangulation = Delaunay(points)
    tetrahedra, neighbors = triangulation.simplices.astype(np.int64), triangulation.neighbors.astype(np.int64)
    columns = np.ascontiguousarray(points.T)
    squared = _tetrahedron_values(columns, tetrahedra)
    facets, facet_values, sides = _facet_values(columns, tetrahedra, neighbors, squared)
    edges, edge_values = _edge_values(columns, facets, facet_values)
    return AlphaComplex(len(points), edges, np.sqrt(edge_values), np.sqrt(facet_values), sides, np.sqrt(squared))


def _tetrahedron_values(columns: Floats, tetrahedra: Integers) -> Floats:
    """Squared circumradii (T,) of tetrahedra (T, 4) of points (3, N); infinite for flat ones."""
    edges = edges_of(columns, tetrahedra)
    numerator, determinant = circumcenters(edges, facing_crosses(edges))
    is_solid = determinant != 0
    squared = dot_columns(numerator, numerator) / np.where(is_solid, determinant, 1.0) ** 2
    return np.where(is_solid, squared, np.inf)


def _facet_values(
    columns: Floats, tetrahedra: Integers, neighbors: Integers, squared: Floats
) -> tuple[Integers, Floats, Integers]:
    """Every facet of tetrahedra (T, 4) of points (3, N) once.

    Returns:
        Vertices (F, 3), squared radii (F,), and the tetrahedra on both sides (F, 2).
    """
    count = len(tetrahedra)
    first, corner = np.nonzero((neighbors < 0) | (np.arange(count)[:, None] < neighbors))
    second = np.where(neighbors[first, corner] < 0, count, neighbors[first, corner])
    facets = facets_at(tetrahedra, first, corner)
    center, radius = _circumcircles(*(columns.take(facets[:, k], axis=1) for k in range(3)))
    values = np.append(squared, np.inf)
    bound = np.minimum(values[first], values[second])
    across = np.append(neighbors, [[-1] * 4], axis=0)[second]
    opposite = (across == first[:, None]).argmax(1)
    apex = columns.take(tetrahedra[first, corner], axis=1) - center
    other = columns.take(np.append(tetrahedra, tetrahedra[:1], axis=0)[second, opposite], axis=1) - center
    is_full = dot_columns(apex, apex) < radius
    is_full |= (dot_columns(other, other) < radius) & (second < count)
    return facets, np.where(is_full, bound, np.minimum(radius, bound)), np.stack((first, second), 1)


def _circumcircles(first: Floats, second: Floats, third: Floats) -> tuple[Floats, Floats]:
    """Centers (3, F) and squared radii (F,) of the circumscribed circles of triangles with corners (3, F)."""
    u, v = second - first, third - first
    w = cross_columns(u, v)
    size = 2 * dot_columns(w, w)
    way = dot_columns(u, u) * cross_columns(v, w) + dot_columns(v, v) * cross_columns(w, u)
    way /= np.where(size > 0, size, 1.0)
    return first + way, np.where(size > 0, dot_columns(way, way), np.inf)


def _edge_values(columns: Floats, facets: Integers, facet_values: Floats) -> tuple[Integers, Floats]:
    """Every edge of facets (F, 3) of points (3, N) once, (E, 2), and its squared radius (E,)."""
    ordered, count = np.sort(facets, axis=1), columns.shape[1]
    keys = np.concatenate([ordered[:, a] * count + ordered[:, b] for a, b in ((0, 1), (0, 2), (1, 2))])
    order, keys_in_order = in_order(keys.view(np.uint64))
    keys = keys_in_order.view(np.int64)
    opposite, values = np.concatenate([ordered[:, c] for c in (2, 1, 0)])[order], np.tile(facet_values, 3)[order]
    first = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
    start, end = np.divmod(keys, count)
    middle = columns.take(opposite, axis=1)
    is_inside = dot_columns(columns.take(start, axis=1) - middle, columns.take(end, axis=1) - middle) < 0
    is_full = np.logical_or.reduceat(is_inside, first)
    bound = np.minimum.reduceat(values, first)
    way = columns.take(start[first], axis=1) - columns.take(end[first], axis=1)
    edges = np.stack((start[first], end[first]), 1)
    return edges, np.where(is_full, bound, np.minimum(dot_columns(way, way) / 4, bound))
