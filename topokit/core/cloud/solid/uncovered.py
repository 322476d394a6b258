"""The part of a found surface that no sample supports: lids over holes of the cloud.

A cut is closed whatever the samples are: it spans each hole of an open cloud with facets that are far from all samples,
or that face where no sample does, like the end of a wall that was cut through. Independent samples leave gaps, too, but
small ones: a region in which a samples are expected is empty with probability exp(−a), whatever its form. So what
counts is how many samples are missing from a connected patch of such facets.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.cloud.settings import QualitySettings
from topokit.core.cloud.solid.tetrahedra import DelaunayComplex, facets_at, separating_facets
from topokit.core.labels import connected_labels

_DENSITY_STEP = 2  # ratio of the spacings at joined samples from which the density jumps between them


@dataclass(frozen=True, eq=False)
class UncoveredPatch:
    """A connected part of the surface of a cut that no sample supports.

    Attributes:
        missing: its area in squared local spacings: about as many samples would be expected there.
        empty: the same of its facets that no point of the cloud is near: a gap, not a wall that was cut through.
        samples: (M,), indices of the samples at its corners.
        facets: (L,), rows of the cut's separating facets, which are the faces of its `CutSurface`.
    """

    missing: float
    empty: float
    samples: Integers
    facets: Integers


def uncovered_patches(
    complex_: DelaunayComplex, inside: Booleans, cloud: Floats, normals: Floats, settings: QualitySettings
) -> tuple[UncoveredPatch, ...]:
    """The uncovered patches of the solid's surface, largest first.

    A facet is uncovered if its point farthest from its corners has no point of the cloud within some spacings, where
    the spacing is the widest of those around its corners, or if it does not face the way the normals at its corners do.
    Samples of a large cloud are sparse where it is flat, so facets there may be wide; but the cloud covers them.

    Args:
        complex_: tetrahedra of N samples.
        inside: (T,).
        cloud: (M, 3), all points, of which the samples are a part.
        normals: (N, 3), unit, outward, of the samples.
        settings: `uncovered` and `facing`.
    """
    tetrahedron, corner = separating_facets(complex_, inside)
    facets = facets_at(complex_.tetrahedra, tetrahedron, corner)
    own, around = complex_.spacing[facets], _spacing_around(complex_.spacing, facets)[facets]
    place, radius = _farthest_places(complex_.points[facets])
    limit = settings.uncovered * around.max(1, initial=0.0)
    wide = np.flatnonzero(radius > limit)  # no place of a facet is farther from all samples than from its corners
    distance = cKDTree(complex_.normalized(cloud)).query(place[wide])[0]
    cosine = np.einsum("fa,fka->fk", complex_.facet_normal[tetrahedron, corner], normals[facets]).mean(1)
    far = wide[distance > limit[wide]]
    found = np.union1d(far, np.flatnonzero(cosine < settings.facing))
    patch = _across_edges(facets[found])
    expected = (complex_.facet_area[tetrahedron, corner] * (own**2).sum(1) / (around**2).sum(1))[found]
    missing, empty = np.bincount(patch, expected), np.bincount(patch, expected * np.isin(found, far))
    return tuple(
        UncoveredPatch(float(missing[number]), float(empty[number]), np.unique(facets[rows]), rows)
        for number in np.argsort(-missing, kind="stable")
        for rows in (found[patch == number],)
    )


def _spacing_around(spacing: Floats, facets: Integers) -> Floats:
    """The spacing (N,) at samples; that of a sample joined to it by a facet (F, 3) where that is over twice as wide.

    Where dense samples border on sparse ones, most neighbors of the outermost sparse ones are dense.
    """
    widest = spacing.copy()
    for first, second in permutations(range(3), 2):
        np.maximum.at(widest, facets[:, first], spacing[facets[:, second]])
    return np.where(widest > _DENSITY_STEP * spacing, widest, spacing)


def _farthest_places(corners: Floats) -> tuple[Floats, Floats]:
    """The place (F, 3) of each triangle (F, 3, 3) far from its corners, and its distance (F,) from the nearest.

    It is the circumcenter of an acute triangle, the middle of the longest side of any other.
    """
    sides = np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1)  # opposite to each corner
    squared = (sides * sides).sum(2)
    weight = squared * (squared.sum(1, keepdims=True) - 2 * squared)
    is_acute = (weight > 0).all(1, keepdims=True)
    weight = np.where(is_acute, weight, squared < squared.max(1, keepdims=True))
    place = np.einsum("fk,fka->fa", weight / weight.sum(1, keepdims=True), corners)
    return place, np.linalg.norm(place[:, None] - corners, axis=2).min(1)


def _across_edges(facets: Integers) -> Integers:
    """The number 0 … of the patch (F,) of each facet (F, 3); patches are connected across edges."""
    ends = np.sort(np.stack((facets, np.roll(facets, -1, axis=1)), axis=2), axis=2).reshape(-1, 2)
    edge = np.unique(ends, axis=0, return_inverse=True)[1].ravel()
    own = np.repeat(np.arange(len(facets)), 3)
    return connected_labels(len(facets) + len(ends), own, len(facets) + edge)[: len(facets)]
