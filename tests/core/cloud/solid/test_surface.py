"""Surfaces of labeled tetrahedra: closed manifolds, however the solid touches itself."""

from __future__ import annotations

import numpy as np
import pytest

from topokit.core.cloud.solid.counts import solid_eulers
from topokit.core.cloud.solid.surface import CutSurface, cut_surface
from topokit.core.cloud.solid.tetrahedra import DelaunayComplex, delaunay_complex, facets_at
from topokit.core.mesh.topology import MeshTopology, mesh_topology


def random_complex(seed: int, n_points: int = 40) -> tuple[DelaunayComplex, np.random.Generator]:
    draws = np.random.default_rng(seed)
    return delaunay_complex(draws.normal(size=(n_points, 3)), np.ones(n_points)), draws


def counted(complex_: DelaunayComplex, surface: CutSurface) -> MeshTopology:
    return mesh_topology(complex_.points[surface.points], surface.faces)


@pytest.mark.parametrize("seed", range(20))
def test_solids_without_contact_with_themselves_have_their_facets_for_a_surface(seed: int) -> None:
    complex_, draws = random_complex(seed)
    inside = np.zeros(len(complex_.tetrahedra), dtype=bool)
    inside[draws.integers(len(inside))] = True
    for _ in range(4):  # grow by the neighbors across one facet, as long as both counts agree
        grown = inside.copy()
        beside = complex_.neighbors[inside]
        grown[draws.choice(beside[beside >= 0])] = True
        counts = solid_eulers(complex_, grown)
        inside = grown if counts[0] == counts[1] else inside
    surface = cut_surface(complex_, inside, 2)
    topology = counted(complex_, surface)
    assert topology.is_closed
    assert topology.euler == surface.euler == 2 * solid_eulers(complex_, inside)[0]
    assert set(surface.points) == set(complex_.tetrahedra[inside].ravel())


def pair(complex_: DelaunayComplex, n_common: int) -> np.ndarray:
    """A labeling of two tetrahedra with this many vertices in common."""
    for first, own in enumerate(complex_.tetrahedra):
        others = np.flatnonzero(np.isin(complex_.tetrahedra, own).sum(axis=1) == n_common)
        if len(others):
            return np.isin(np.arange(len(complex_.tetrahedra)), (first, others[0]))
    raise LookupError(n_common)


@pytest.mark.parametrize("n_common", [1, 2])
def test_two_tetrahedra_that_touch_are_two_spheres(n_common: int) -> None:
    complex_, _ = random_complex(0)
    surface = cut_surface(complex_, pair(complex_, n_common), 4)
    topology = counted(complex_, surface)
    assert topology.is_closed
    assert sorted(topology.components.euler) == [2, 2]


def test_the_surface_of_all_tetrahedra_is_the_convex_hull_and_so_is_that_around_touching_holes() -> None:
    complex_, _ = random_complex(0)
    holes = pair(complex_, 1)
    hull = cut_surface(complex_, np.ones_like(holes), 2)
    assert counted(complex_, hull).is_closed
    convex_hull = facets_at(complex_.tetrahedra, *np.nonzero(complex_.neighbors < 0))
    assert len(hull.faces) == len(convex_hull)
    inner = ~np.isin(complex_.tetrahedra, convex_hull).any(axis=1)
    rows = np.flatnonzero(inner)
    surface = cut_surface(complex_, ~np.isin(np.arange(len(inner)), rows[:1]), 4)
    assert sorted(counted(complex_, surface).components.euler) == [2, 2]


def test_edges_are_joined_or_separated_as_the_integer_demands() -> None:
    """Two tetrahedra with an edge in common: one ball, or two."""
    complex_, _ = random_complex(1, 60)
    inside = pair(complex_, 2)
    separated, joined = (cut_surface(complex_, inside, euler).euler for euler in (4, 2))
    assert (separated, joined) == (4, 2)


@pytest.mark.parametrize("euler", [2, 4])
def test_faces_are_counterclockwise_seen_from_outside_even_where_they_touch(euler: int) -> None:
    complex_, _ = random_complex(1, 60)
    inside = pair(complex_, 2)
    surface = cut_surface(complex_, inside, euler)
    a, b, c = complex_.points[surface.points][surface.faces].swapaxes(0, 1)
    enclosed = (a * np.cross(b, c)).sum() / 6
    edges = np.diff(complex_.points[complex_.tetrahedra[inside]], axis=1)
    assert enclosed == pytest.approx(np.abs(np.linalg.det(edges)).sum() / 6)


def test_no_tetrahedron_inside_gives_no_faces() -> None:
    complex_, _ = random_complex(0)
    assert len(cut_surface(complex_, np.zeros(len(complex_.tetrahedra), dtype=bool), 2).faces) == 0
