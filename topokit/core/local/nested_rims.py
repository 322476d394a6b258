"""Rims that lie within another one in a plane, with nothing between: what closes them decides the genus.

An object whose underside was not seen, and whose holes end there, has such rims. A disc in each of them makes another
surface than the ring between them, which is the underside.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from topokit.core.arrays import Floats

_FLAT = 0.1  # of the outer rim's width: how far two rims in one plane may be from it
_NEAR = 2.5  # spacings from a sample that cover a place
_PROBES = 48  # places along the longer side of the outer rim
_COVERED = 0.5  # share of the ring from which the surface itself lies there


def has_open_ring(rims: Sequence[Floats], samples: Floats, spacing: float) -> bool:
    """Whether a rim lies within another one in its plane, and no surface between the two.

    Args:
        rims: points (N, 3) of each.
        samples: (M, 3), of the surface.
        spacing: of the samples, in units of length.
    """
    if len(rims) < 2:
        return False
    tree = cKDTree(samples)
    return any(_is_ring(outer, inner, tree, spacing) for outer, inner in permutations(rims, 2))


def _is_ring(outer: Floats, inner: Floats, tree: cKDTree, spacing: float) -> bool:
    center = outer.mean(0)
    axes, width = np.linalg.svd(outer - center, full_matrices=False)[2], float(np.ptp(outer, axis=0).max())
    both = (np.concatenate((outer, inner)) - center) @ axes.T
    sides = np.ptp(both[: len(outer), :2], axis=0)
    if np.abs(both[:, 2]).max() > _FLAT * width or sides.min() < spacing or len(outer) < 4:
        return False
    outline, hole = both[: len(outer), :2], both[len(outer) :, :2]
    hull = Delaunay(outline)
    if (hull.find_simplex(hole) < 0).any():
        return False
    ticks = [np.linspace(low, high, _PROBES) for low, high in zip(outline.min(0), outline.max(0), strict=True)]
    places = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    low, high = hole.min(0), hole.max(0)
    is_between = (hull.find_simplex(places) >= 0) & ~((places >= low) & (places <= high)).all(1)
    is_between &= cKDTree(both[:, :2]).query(places)[0] > 2 * _NEAR * spacing
    if not is_between.any():
        return False
    distance = tree.query(center + places[is_between] @ axes[:2])[0]
    return float((distance < _NEAR * spacing).mean()) < _COVERED
