"""Exact counts of a labeling of Delaunay tetrahedra: Euler characteristics, components and cavities."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Booleans
from topokit.core.cloud.solid.tetrahedra import EDGES, FACETS, DelaunayComplex, facets_at, separating_facets
from topokit.core.labels import connected_labels, count_distinct

_FACET_EDGES = np.array([[k for k, edge in enumerate(EDGES) if set(edge) <= set(facet)] for facet in FACETS])
"""Edges of the facet opposite to each vertex of a tetrahedron."""


def solid_eulers(complex_: DelaunayComplex, inside: Booleans) -> tuple[int, int]:
    """Euler characteristic of the solid, counted from the closed inside and from the closed outside (with infinity).

    Both are bounded by one surface; where that is a manifold the numbers agree, and its own is twice each.
    """
    n_facets = len(separating_facets(complex_, inside)[0])
    tetrahedron, corner = np.nonzero(complex_.neighbors < 0)  # infinity makes one more tetrahedron of each hull facet
    hull_points = facets_at(complex_.tetrahedra, tetrahedron, corner)
    hull_edges = complex_.edges[tetrahedron[:, None], _FACET_EDGES[corner]]
    n_inside, n_outside = int(inside.sum()), int((~inside).sum()) + len(tetrahedron)
    within = _counted(complex_.tetrahedra, inside) - _counted(complex_.edges, inside)
    beyond = _counted(complex_.tetrahedra, ~inside, hull_points) - _counted(complex_.edges, ~inside, hull_edges)
    at_infinity = 1 - count_distinct(hull_points.ravel())  # the vertex and its edges
    # of closed tetrahedra every facet belongs to two, but for those of the surface
    return within + _facets(n_inside, n_facets), beyond + at_infinity + _facets(n_outside, n_facets)


def _counted(numbers: NDArray[np.integer], chosen: Booleans, more: NDArray[np.integer] | None = None) -> int:
    """How many different numbers the chosen rows hold, and some more numbers."""
    occurs = np.zeros(int(numbers.max()) + 1, dtype=bool)
    occurs[numbers[chosen]] = True
    if more is not None:
        occurs[more] = True
    return int(np.count_nonzero(occurs))


def _facets(n_tetrahedra: int, n_surface_facets: int) -> int:
    """F − T of closed tetrahedra."""
    return (4 * n_tetrahedra + n_surface_facets) // 2 - n_tetrahedra


def count_parts(complex_: DelaunayComplex, inside: Booleans) -> tuple[int, int]:
    """Number of components of the solid and of its cavities (bounded components of the outside), joined by facets."""
    count = len(inside)
    label = np.append(inside, False)
    here = np.broadcast_to(np.arange(count)[:, None], complex_.neighbors.shape)
    there = np.where(complex_.neighbors < 0, count, complex_.neighbors)
    same = label[here] == label[there]
    part = connected_labels(count + 1, here[same], there[same])
    n_parts = count_distinct(part[:count][inside]) if inside.any() else 0
    return n_parts, count_distinct(part[~label]) - 1
