"""Planar caps over the holes of an open cloud, found by winding numbers: the underside on which an object stood.

Let the surface of a solid be known but for what lies in one plane that the solid touches from one side. In that plane
its winding number is one half where the surface is missing, and one or zero elsewhere: a missing piece fills no solid
angle in its own plane, and the closed surface has one half there on average of both sides. So what is missing need
not be simply connected: under a ring that lies on a table it is a ring.

References:
    G. Barill, N. G. Dickson, R. Schmidt, D. I. W. Levin, A. Jacobson, "Fast winding numbers for soups and clouds", ACM
    TOG 37(4), 2018, doi:10.1145/3197517.3201337.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Floats
from topokit.core.surface import vector_areas

_PAIRS = 1 << 22  # of places and samples whose solid angles are summed at once
_INSIDE = 0.25  # winding number from which a place of the plane lies under the solid; it is one half there, zero beside
_FREE = 1.0  # spacings to the nearest sample, at least, of a place where a surface is missing
_MOST = 20_000  # places of a plane that are looked at; where a spacing would make more, their step is longer
_FITS = 3  # of a plane to the corners near it
_NEAR = 1.5  # spacings from the plane


@dataclass(frozen=True, eq=False)
class OrientedLayer:
    """Samples (N, 3) of a surface with outward unit normals (N, 3), and the area (N,) that each stands for."""

    points: Floats
    normals: Floats
    areas: Floats

    @property
    def spacing(self) -> float:
        """Typical distance of neighbors, in units of length."""
        return math.sqrt(float(self.areas.mean()))

    def winding_numbers(self, places: Floats) -> Floats:
        """Share of all directions (P,) in which the layer is seen from places (P, 3), positive from inside."""
        found = np.zeros(len(places))
        for rows in np.array_split(np.arange(len(places)), len(places) * len(self.points) // _PAIRS + 1):
            offsets = self.points - places[rows, None]
            squared = np.maximum(np.einsum("pna,pna->pn", offsets, offsets), np.finfo(float).tiny)
            along = np.einsum("pna,na->pn", offsets, self.normals)
            found[rows] = (along / (squared * np.sqrt(squared))) @ self.areas
        return found / (4 * math.pi)

    def joined(self, points: Floats, normal: Floats, step: float) -> OrientedLayer:
        """The layer with samples (M, 3) of one normal (3,) that lie in a square grid of some step."""
        normals = np.broadcast_to(normal, points.shape)
        areas = np.full(len(points), step**2)
        own = (self.points, points), (self.normals, normals), (self.areas, areas)
        return OrientedLayer(*(np.concatenate(pair) for pair in own))


def planar_caps(layer: OrientedLayer, lids: Iterable[Floats]) -> tuple[Floats, Floats]:
    """Samples of what is missing in the planes of holes.

    Args:
        layer: what was seen.
        lids: triangles (F, 3, 3) that span each hole, counterclockwise seen from outside; the widest hole first.

    Returns:
        Places (M, 3), none where the plane holds nothing of the kind, and outward unit normals (M, 3).
    """
    found = layer
    for triangles in lids:
        corners = np.unique(triangles.reshape(-1, 3), axis=0)
        found = _with_cap(found, corners, _outward(triangles, corners, layer.spacing), layer.spacing)
    first = len(layer.points)
    return found.points[first:], found.normals[first:]


def flat_share(triangles: Floats, spacing: float) -> float:
    """The share of a lid's area, of triangles (F, 3, 3), near the plane that supports it, where a cap is looked for."""
    areas = np.linalg.norm(vector_areas(triangles), axis=1)
    heights = triangles @ _outward(triangles, np.unique(triangles.reshape(-1, 3), axis=0), spacing)
    is_near = heights.min(1) > heights.max() - _NEAR * spacing
    return float(areas[is_near].sum() / max(float(areas.sum()), np.finfo(float).tiny))


def _outward(triangles: Floats, corners: Floats, spacing: float) -> Floats:
    """The outward normal (3,) of the plane that supports a lid, of which the corners (N, 3) are given, too.

    The vector area of a lid depends on its rim alone. The plane is fitted again to the corners that are near it.
    """
    area = vector_areas(triangles).sum(0)
    normal: Floats = area / max(float(np.linalg.norm(area)), np.finfo(float).tiny)
    for _ in range(_FITS):
        heights = corners @ normal
        near = corners[heights > heights.max() - _NEAR * spacing]
        if len(near) < 3:
            break
        axis = np.linalg.svd(near - near.mean(0), full_matrices=False)[2][2]
        normal = axis if axis @ normal > 0 else -axis
    return normal


def _with_cap(layer: OrientedLayer, corners: Floats, normal: Floats, spacing: float) -> OrientedLayer:
    """The layer with samples in the plane through the outermost corner of a lid, where a surface is missing."""
    across, place = np.linalg.svd(normal[None])[2][1:], corners[(corners @ normal).argmax()]
    rim = (corners - place) @ across.T
    step = max(spacing, math.sqrt(float(np.ptp(rim, axis=0).prod()) / _MOST))
    ticks = [np.arange(low, high + step, step) for low, high in zip(rim.min(0), rim.max(0), strict=True)]
    places = place + np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 2) @ across
    places = places[cKDTree(layer.points).query(places)[0] > _FREE * spacing]
    winding = layer.winding_numbers(places)
    return layer.joined(places[(winding > _INSIDE) & (winding < 1 - _INSIDE)], normal, step)
