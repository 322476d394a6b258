"""An adaptive second view of the solid: Delaunay tetrahedra of the samples, labeled by one minimum cut.

A grid needs cells smaller than the thinnest sheet. Delaunay tetrahedra adapt by themselves: two sheets a fraction of a
sample spacing apart are still joined by tetrahedra that lie between them. Each tetrahedron is labeled inside or outside
so that the separating facets are small, face the way the samples' normals do, and belong to large empty spheres on both
sides. Areas are in units of the sample spacing at their corners: a facet of a fine detail weighs as much as one of a
coarse face. The Euler characteristics of the closed inside and of the closed outside are exact integers; where the
separating surface is a manifold they agree, so that their difference is itself evidence.

References:
    P. Labatut, J.-P. Pons, R. Keriven, "Robust and efficient surface reconstruction from range data", CGF 28(8), 2009,
    doi:10.1111/j.1467-8659.2009.01530.x, for cut and sphere term; the directed normal term is ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow
from scipy.spatial import Delaunay, QhullError

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.cloud.guards import is_flat
from topokit.core.cloud.sampling.cube_hierarchy import curve_order
from topokit.core.cloud.settings import CutWeights
from topokit.core.cloud.solid.columns import circumcenters, dot_columns, edges_of, facing_crosses
from topokit.errors import InputError

FACETS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
"""Vertices of the facet opposite to each vertex of a tetrahedron."""

EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
"""Vertices of the edges of a tetrahedron."""

_UNITS = 1000  # integer flow units per unit of cost
_MOST_UNITS = 2**24  # of one edge: their sum over a hundred thousand samples fits SciPy's 32 bits with room to spare
_DISPLACEMENT = 0.02  # largest shift of a sample, in spacings: samples in one plane make Qhull slow


@dataclass(frozen=True, eq=False)
class DelaunayComplex:
    """Delaunay tetrahedra of N points with what the cut needs; areas in units of the squared local spacing.

    Attributes:
        points: (N, 3), centered, in units of the median spacing, and displaced by up to 2 % of their own.
        spacing: (N,), typical distance to the neighbors of each, in the same unit.
        tetrahedra: (T, 4), vertex indices; in the order of a curve, so that flows and sums find neighbors in the cache.
        neighbors: (T, 4), tetrahedron across the facet opposite to each vertex, −1 outside the hull.
        facet_area: (T, 4).
        facet_normal: (T, 4, 3), unit, outward from the tetrahedron.
        centers: (T, 3), of the circumspheres; of slivers the centroid.
        sphere_cost: (T, 4), from 0 where the spheres on both sides meet the facet far from their center to 1.
        middle: (3,), center of the samples' box before they were centered.
        unit_length: the median spacing before they were scaled.
    """

    points: Floats
    spacing: Floats
    tetrahedra: Integers
    neighbors: Integers
    facet_area: Floats
    facet_normal: Floats
    centers: Floats
    sphere_cost: Floats
    middle: Floats
    unit_length: float

    def normalized(self, points: Floats) -> Floats:
        """Points (M, 3) from where the samples came, centered and scaled as these."""
        return (points - self.middle) / self.unit_length

    @cached_property
    def corner_directions(self) -> Floats:
        """(T, 4, 3), unit vectors from the centroid of each tetrahedron to its corners."""
        way = self.points.take(self.tetrahedra, axis=0)
        way -= way.mean(1, keepdims=True)
        way /= np.maximum(np.sqrt(np.einsum("tca,tca->tc", way, way)), 1e-12)[..., None]
        return way

    @cached_property
    def surface(self) -> Floats:
        """(T,), surface area of each tetrahedron."""
        return self.facet_area.sum(1)

    @cached_property
    def edges(self) -> NDArray[np.int32]:
        """(T, 6), number 0 … E−1 of each edge; the same in all tetrahedra around it."""
        ends = np.sort(self.tetrahedra[:, EDGES], axis=2)
        key = (ends[..., 0] * len(self.points) + ends[..., 1]).ravel()
        order = np.argsort(key)
        number = np.empty(len(key), dtype=np.int32)
        number[order] = np.cumsum(np.diff(key[order], prepend=-1) > 0) - 1
        return number.reshape(-1, 6)


@dataclass(frozen=True, eq=False)
class Cut:
    """A labeling of the tetrahedra.

    Attributes:
        inside: (T,).
        energy: its cost per sample.
        coverage: share of the samples on the separating surface.
    """

    inside: Booleans
    energy: float
    coverage: float


def delaunay_complex(points: Floats, spacing: Floats) -> DelaunayComplex:
    """Delaunay tetrahedra of points in space.

    Args:
        points: (N, 3).
        spacing: (N,), typical distance of each to its neighbors; it makes the cut's weights free of units.

    Raises:
        InputError: if the points lie in a plane, on a line or in one place, or are fewer than five.
    """
    unit_length = float(np.median(spacing))
    middle = (points.max(0) + points.min(0)) / 2
    points, spacing = (points - middle) / unit_length, spacing / unit_length
    refusal = (
        f"the {len(points)} points span no volume (a plane, a line or one place), or are not finite: "
        "they have no tetrahedra and bound no solid."
    )
    if len(points) < 4 or not np.isfinite(points).all() or is_flat(points):
        raise InputError(refusal)
    shift = np.random.default_rng(0).uniform(-_DISPLACEMENT, _DISPLACEMENT, points.shape)
    points = points + spacing[:, None] * shift
    try:
        triangulation = Delaunay(points, qhull_options="Qbb Qc Qz Q12")
    except (QhullError, ValueError) as error:
        raise InputError(refusal) from error
    tetrahedra, neighbors = _along_curve(points, triangulation.simplices, triangulation.neighbors)
    normal, length, center, cosine = _facets_and_spheres(points, tetrahedra)
    on_hull = neighbors < 0
    across = np.where(on_hull, 0, neighbors)
    back = (neighbors.take(across, axis=0) == np.arange(len(tetrahedra))[:, None, None]).argmax(2)
    other = np.where(on_hull, 1.0, cosine.ravel().take(4 * across + back))
    sphere_cost = (1 - np.clip(np.minimum(cosine, other), -1, 1)) / 2
    squared = spacing.take(tetrahedra) ** 2
    area = length / 2 / ((squared.sum(1, keepdims=True) - squared) / 3)  # of the three corners of each facet
    return DelaunayComplex(
        points, spacing, tetrahedra, neighbors, area, normal, center, sphere_cost, middle, unit_length
    )


def _along_curve(
    points: Floats, tetrahedra: NDArray[np.int32], neighbors: NDArray[np.int32]
) -> tuple[Integers, Integers]:
    """Tetrahedra and their neighbors (T, 4) in the order of their centroids along a curve: flows are faster so."""
    order, _ = curve_order(points.take(tetrahedra, axis=0).mean(1))
    number = np.full(len(order) + 1, -1)  # the last one is that of outside
    number[order] = np.arange(len(order))
    return tetrahedra.take(order, axis=0).astype(np.int64), number.take(neighbors.take(order, axis=0), mode="wrap")


def _facets_and_spheres(points: Floats, tetrahedra: Integers) -> tuple[Floats, Floats, Floats, Floats]:
    """Outward unit normals (T, 4, 3) of the facets and twice their areas (T, 4), centers (T, 3) of the circumspheres,
    by Cramer's rule, and the cosines (T, 4) of the angles that facets make with radii to their corners.

    Of slivers the centroid is taken for the center.
    """
    columns = np.ascontiguousarray(points.T)
    edges = a, b, c = edges_of(columns, tetrahedra)
    crosses = bc, ca, ab = facing_crosses(edges)
    numerator, determinant = circumcenters(edges, crosses)
    side = np.sign(determinant)
    normal = np.stack((side * (bc + ca + ab), -side * bc, -side * ca, -side * ab))  # (4, 3, T)
    length = np.sqrt(np.einsum("fat,fat->ft", normal, normal))
    normal /= np.maximum(length, 1e-300)[:, None]
    is_solid = np.abs(determinant) > 1e-12
    offset = numerator / np.where(is_solid, determinant, 1.0)
    offset = np.where(is_solid, offset, (a + b + c) / 4)
    radius = np.maximum(np.sqrt(dot_columns(offset, offset)), 1e-12)
    height = -np.einsum("at,fat->ft", offset, normal)  # of the facets over the center
    height[0] += dot_columns(a, normal[0])  # the only facet without the first corner
    return (
        np.ascontiguousarray(normal.transpose(2, 0, 1)),
        np.ascontiguousarray(length.T),
        np.ascontiguousarray((columns.take(tetrahedra[:, 0], axis=1) + offset).T),
        np.ascontiguousarray((height / radius).T),
    )


def cut_complex(complex_: DelaunayComplex, normals: Floats, weights: CutWeights) -> Cut:
    """The labeling of least energy for given normals, by one maximum flow.

    A facet f from inside to outside costs its area × (w.area + w.normal · (1 − mean f·n) / 2 + w.sphere · sphere cost);
    a label costs w.side × the tetrahedron's surface × the mean cosine between the normals and the ways from its
    centroid to its vertices. Outside the hull is outside.

    Args:
        complex_: tetrahedra of N points.
        normals: (N, 3), unit, outward.
        weights: of the four terms of the energy.
    """
    tetrahedra, neighbors, count = complex_.tetrahedra, complex_.neighbors, len(complex_.tetrahedra)
    corner_normal = normals.take(tetrahedra, axis=0)
    side = weights.side * np.einsum("tca,tca->tc", complex_.corner_directions, corner_normal).mean(1) * complex_.surface
    total = np.einsum("tca,ta->tc", complex_.facet_normal, corner_normal.sum(1))  # f · (sum of the four normals)
    agreement = (total - np.einsum("tca,tca->tc", complex_.facet_normal, corner_normal)) / 3
    per_area = weights.area + weights.normal * (1 - agreement) / 2 + weights.sphere * complex_.sphere_cost
    cost = complex_.facet_area * per_area
    on_hull = neighbors < 0
    leave = (cost * on_hull).sum(1)
    here = np.broadcast_to(np.arange(count)[:, None], neighbors.shape)
    source, sink = count, count + 1
    rows = np.concatenate((here[~on_hull], np.full(count, source), np.arange(count)))
    columns = np.concatenate((neighbors[~on_hull], np.arange(count), np.full(count, sink)))
    costs = (cost[~on_hull], np.maximum(side, 0), np.maximum(-side, 0) + leave)
    capacity = np.concatenate([np.minimum(np.round(one * _UNITS), _MOST_UNITS).astype(np.int32) for one in costs])
    used = capacity > 0  # one arc in six has none
    graph = coo_matrix((capacity[used], (rows[used], columns[used])), shape=(count + 2, count + 2)).tocsr()
    value, inside = _minimum_cut(graph, source, sink)
    touched = surface_normals(complex_, inside[:count], normals)[1]
    return Cut(inside[:count], value / _UNITS / len(complex_.points), float(touched.mean()))


def _minimum_cut(graph: csr_matrix, source: int, sink: int) -> tuple[float, Booleans]:
    """Capacity of the minimum cut, and which nodes are on the source's side: all that the residual graph reaches."""
    flow = maximum_flow(graph, source, sink, method="dinic")
    residual = graph - flow.flow
    residual.data = np.maximum(residual.data, 0)
    residual.eliminate_zeros()
    reached = np.zeros(graph.shape[0], dtype=bool)
    reached[breadth_first_order(residual, source, return_predecessors=False)] = True
    return float(flow.flow_value), reached


def surface_normals(complex_: DelaunayComplex, inside: Booleans, fallback: Floats) -> tuple[Floats, Booleans]:
    """Outward area-weighted unit normals (N, 3) of the separating surface, and which samples lie on it, (N,).

    Args:
        complex_: tetrahedra of N points.
        inside: (T,).
        fallback: (N, 3), used for samples off the surface.
    """
    tetrahedron, corner = separating_facets(complex_, inside)
    area = complex_.facet_area[tetrahedron, corner][:, None] * complex_.facet_normal[tetrahedron, corner]
    vertices = facets_at(complex_.tetrahedra, tetrahedron, corner).ravel()
    count = len(complex_.points)
    total = np.stack([np.bincount(vertices, np.repeat(area[:, axis], 3), count) for axis in range(3)], 1)
    size = np.linalg.norm(total, axis=1)
    return np.where(size[:, None] > 0, total / np.maximum(size, 1e-300)[:, None], fallback), size > 0


def facets_at(tetrahedra: Integers, tetrahedron: Integers, corner: Integers) -> Integers:
    """Vertices (F, 3) of facets, from the tetrahedra (F,) that they are of and the corners (F,) opposite to them."""
    return tetrahedra[tetrahedron[:, None], FACETS[corner]]


def separating_facets(complex_: DelaunayComplex, inside: Booleans) -> tuple[Integers, Integers]:
    """Inside tetrahedra whose facet opposite to `corner` borders the outside."""
    beyond = np.append(inside, False)[complex_.neighbors]  # index −1 is the appended outside
    tetrahedron, corner = np.nonzero(inside[:, None] & ~beyond)
    return tetrahedron, corner
