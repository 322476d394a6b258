"""The surface of a cut: edges and vertices where it touches itself are taken apart.

The facets between inside and outside tetrahedra may meet four at an edge, or in several fans at a vertex. Whether the
solid is joined there or separated is a choice, like the connectivity of voxels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topokit.core.arrays import Booleans, Integers
from topokit.core.cloud.solid.tetrahedra import DelaunayComplex, facets_at, separating_facets
from topokit.core.labels import connected_labels
from topokit.core.surface import vector_areas


@dataclass(frozen=True, eq=False)
class CutSurface:
    """A closed surface of triangles between points.

    Attributes:
        points: (V,), the point on which each vertex lies; several vertices lie on a point where the surface touches
            itself.
        faces: (F, 3), vertex indices; counterclockwise seen from outside the solid.
    """

    points: Integers
    faces: Integers

    @property
    def euler(self) -> int:
        """V − E + F, where every edge has two faces."""
        return len(self.points) - len(self.faces) // 2


def cut_surface(complex_: DelaunayComplex, inside: Booleans, euler: int) -> CutSurface:
    """The boundary of the solid, joined or separated at the edges where it touches itself: as gives χ, else joined.

    At single points the sheets are always separated. Where two copies of an edge keep both ends in common, the
    triangles are no manifold; check before you rely on it.

    Args:
        complex_: tetrahedra of N points.
        inside: (T,).
        euler: the Euler characteristic that the surface should have.
    """
    joined = _taken_apart(complex_, inside, joined=True)
    if joined.euler == euler:
        return joined
    separated = _taken_apart(complex_, inside, joined=False)
    return separated if separated.euler == euler else joined


def _taken_apart(complex_: DelaunayComplex, inside: Booleans, *, joined: bool) -> CutSurface:
    """The boundary of the solid; every edge gets two faces and every vertex one fan."""
    tetrahedron, corner = separating_facets(complex_, inside)
    faces = _facing(complex_, facets_at(complex_.tetrahedra, tetrahedron, corner), tetrahedron, corner)
    if len(faces) == 0:
        return CutSurface(faces.ravel(), faces)
    fans = _fans(faces, _across_edges(complex_, inside, tetrahedron, corner, faces, joined))
    points = np.empty(int(fans.max()) + 1, dtype=np.int64)
    points[fans] = faces.ravel()
    return CutSurface(points, fans.reshape(-1, 3))


def _facing(complex_: DelaunayComplex, faces: Integers, tetrahedron: Integers, corner: Integers) -> Integers:
    """Facets (F, 3), counterclockwise seen from outside the tetrahedra (F,) opposite to whose corners (F,) they are."""
    is_turned = (vector_areas(complex_.points[faces]) * complex_.facet_normal[tetrahedron, corner]).sum(1) < 0
    return np.where(is_turned[:, None], faces[:, ::-1], faces)


def _across_edges(
    complex_: DelaunayComplex,
    inside: Booleans,
    tetrahedron: Integers,
    corner: Integers,
    faces: Integers,
    joined: bool,
) -> Integers:
    """The half-edge (3 F,) that continues the surface across each half-edge; number 3 f + i is opposite corner i of f.

    From every facet a walk turns around the edge, through the outside if the solid is joined there and through the
    inside if not, until it comes to another facet. Walks that leave the hull meet at infinity.
    """
    ends = np.stack((np.roll(faces, -1, axis=1).ravel(), np.roll(faces, -2, axis=1).ravel()), axis=1)
    start = complex_.neighbors[tetrahedron, corner] if joined else tetrahedron
    here, third = np.repeat(start, 3), faces.ravel().copy()
    walking = np.flatnonzero(here >= 0)
    while len(walking):
        own = complex_.tetrahedra[here[walking]]
        exit_corner = (own == third[walking, None]).argmax(axis=1)
        following = complex_.neighbors[here[walking], exit_corner]
        third[walking] = own.sum(axis=1) - ends[walking].sum(axis=1) - third[walking]
        is_outside = (following < 0) | ~inside[following]
        goes_on = is_outside if joined else ~is_outside
        here[walking] = np.where(goes_on, following, here[walking])
        walking = walking[goes_on & (following >= 0)]
    return _half_edges_at(faces, ends, third, here < 0)


def _half_edges_at(faces: Integers, ends: Integers, third: Integers, at_infinity: Booleans) -> Integers:
    """The half-edges where walks have ended: at the facet of an edge (3 F, 2) and a third point, or at infinity."""
    base = np.int64(faces.max() + 1)

    def keys(triples: Integers) -> Integers:
        low, middle, high = np.sort(triples, axis=1).T
        return (low * base + middle) * base + high

    own_keys = keys(faces)
    order = np.argsort(own_keys)
    reached = np.flatnonzero(~at_infinity)
    face = order[np.searchsorted(own_keys[order], keys(np.column_stack((ends, third))[reached]))]
    partner = np.empty(len(third), dtype=np.int64)
    partner[reached] = 3 * face + (faces[face] == third[reached, None]).argmax(axis=1)
    far = np.flatnonzero(at_infinity)
    low, high = np.sort(ends[far], axis=1).T
    pairs = far[np.argsort(low * base + high, kind="stable")].reshape(-1, 2)  # two walks from every edge of the hull
    partner[pairs] = pairs[:, ::-1]
    return partner


def _fans(faces: Integers, partner: Integers) -> Integers:
    """(3 F,), the fan of every corner: corners of one point, joined across edges."""
    half = np.flatnonzero(np.arange(len(partner)) < partner)
    corners, other = faces.ravel(), partner[half]
    joins = []
    for step in (1, 2):
        mine = half - half % 3 + (half % 3 + step) % 3
        for other_step in (1, 2):
            theirs = other - other % 3 + (other % 3 + other_step) % 3
            same = corners[mine] == corners[theirs]
            joins.append((mine[same], theirs[same]))
    first, second = (np.concatenate(side) for side in zip(*joins, strict=True))
    return connected_labels(len(corners), first, second)
