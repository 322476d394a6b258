"""Homotopic closing: fills of gaps between parts, of tunnels and of cavities, each by a layer of few voxels.

The solid grows through the background in the order of the distance from it, and only by simple points, so that its
topology stays. Where fronts meet, voxels are left that are not simple: one of them joins two parts, closes a tunnel or
fills a cavity, at the distance at which persistent homology has that class disappear. Which of them close a tunnel and
which would wall off a cavity or close a loop, Kruskal's algorithm decides, the narrowest place of each tunnel first.
Those that are wanted are filled, and the solid shrinks back to where it was, again by simple points only: what remains
of its growth are one bridge, membrane or filled cavity for each.

Applied to the background, the same opens what is thin: it opens walls of cavities, cuts handles and drops parts.

References:
    D. Attali, U. Bauer, O. Devillers, M. Glisse, A. Lieutier, "Homological reconstruction and simplification in R3",
    Computational Geometry 48, 2015, doi:10.1016/j.comgeo.2014.08.010 (the problem; an optimum is NP-hard to find).
    Z. Aktouf, G. Bertrand, L. Perroton, "A three-dimensional holes closing algorithm", Pattern Recognition Letters 23,
    2002, doi:10.1016/S0167-8655(01)00152-0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.ndimage import label, uniform_filter
from scipy.spatial import cKDTree

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.grid.euler import dual_connectivity, solid_euler
from topokit.core.homotopy.growth import grow, joins, numbers_at, strides_around
from topokit.core.homotopy.simple_points import OFFSETS, Counts, Indices

_CORNERS = np.ones((3, 3, 3))
_STEPS = np.abs(OFFSETS).sum(axis=1)  # 1 across a face

_ROUNDS = 4  # of shrinking back
_VICINITY = 5  # voxels

Widths = Callable[[Integers], Floats]


class Filled(NamedTuple):
    """A class of homology that a patch removes.

    Attributes:
        dimension: 0 for a part that is joined to another one, 1 for a tunnel, 2 for a cavity.
        voxel: index (3,) of the place that is narrowest.
        width: there.
    """

    dimension: int
    voxel: Integers
    width: float


class Patch(NamedTuple):
    """Voxels (N,), as flat indices, that join the solid, and what they remove."""

    voxels: Indices
    filled: tuple[Filled, ...]


def closing(
    solid: Booleans,
    distance: Floats,
    reach: float,
    widths: Widths,
    wanted: Callable[[int, Floats], Booleans],
    cost: Floats | None,
    connectivity: int,
) -> list[Patch]:
    """The patches that fill gaps, tunnels and cavities of a solid; any choice of them may be applied.

    Args:
        solid: (X, Y, Z), with a layer around it that is not changed.
        distance: (X, Y, Z) of voxels of the background from the solid.
        reach: largest distance of a voxel that may be filled.
        widths: of places, given by their indices (M, 3).
        wanted: which classes of a dimension and of some widths (M,) are filled.
        cost: (X, Y, Z), what it costs to fill each voxel; None if all cost the same.
        connectivity: 6 or 26, that of the solid.
    """
    around = strides_around(solid.shape)
    work = solid.ravel().astype(np.int8)
    may = ~solid & (distance <= reach)
    may[[0, -1]] = may[:, [0, -1]] = may[:, :, [0, -1]] = False
    waiting = np.flatnonzero(may)
    around_each = uniform_filter(distance, _VICINITY).ravel()  # of equally narrow places the middle of a narrow part
    waiting = waiting[np.lexsort((around_each[waiting], distance.ravel()[waiting]))]
    found: list[Filled] = []
    while True:
        grow(work, waiting[work[waiting] == 0], around, connectivity)
        waiting = waiting[work[waiting] == 0]
        new = []
        for dimension, voxels in _ends(work, waiting, solid.shape, around, connectivity):
            places = np.stack(np.unravel_index(voxels, solid.shape), axis=1)
            sizes = widths(places) if len(places) else np.empty(0)
            rows = np.flatnonzero(wanted(dimension, sizes))
            new += [(int(voxels[k]), Filled(dimension, places[k], float(sizes[k]))) for k in rows]
        filled = [one for voxel, one in new if _fills(work, voxel, one.dimension, around, connectivity)]
        if not filled:
            break
        found += filled
    return _patches(solid, work, found, cost, around, connectivity)


def _ends(
    work: Counts, waiting: Indices, shape: tuple[int, ...], around: Integers, connectivity: int
) -> list[tuple[int, Indices]]:
    """Voxels at which a class of each dimension ends, among those in the order of their distance."""
    solid, background = numbers_at(work, waiting, around, connectivity)
    between = waiting[(solid > 1) & (background == 1)]
    parts = _labels(work.reshape(shape) != 0, connectivity)
    is_bridge = joins(work.copy(), parts, between, around, connectivity) == 1
    across = waiting[(solid == 1) & (background > 1)][::-1]
    rest = 1 - work
    rest[across] = 0
    regions = _labels(rest.reshape(shape) != 0, dual_connectivity(connectivity))
    stays_open = joins(rest, regions, across, around, dual_connectivity(connectivity)) == 1
    last = waiting[(solid == 1) & (background == 0)]
    return [(0, between[is_bridge]), (1, across[~stays_open]), (2, last)]


def _labels(mask: Booleans, connectivity: int) -> Integers:
    return np.asarray(label(mask, _CORNERS if connectivity == 26 else None)[0], dtype=np.int64).ravel()


def _fills(work: Counts, voxel: int, dimension: int, around: Integers, connectivity: int) -> bool:
    """Fill a voxel if it still ends a class of that dimension, now that others have been filled."""
    solid, background = (int(one[0]) for one in numbers_at(work, np.array([voxel]), around, connectivity))
    is_end = (solid > 1 and background == 1, solid == 1 and background > 1, solid == 1 and background == 0)[dimension]
    if is_end:
        work[voxel] = 1
    return is_end


def _patches(
    solid: Booleans, work: Counts, found: list[Filled], cost: Floats | None, around: Integers, connectivity: int
) -> list[Patch]:
    """What is left of the growth when it has shrunk back, with what each patch fills."""
    if not found:
        return []
    groups = _layers(solid, work, np.stack([one.voxel for one in found]), cost, around, connectivity)
    parts = _labels(solid, connectivity)
    holes = _labels(~solid, dual_connectivity(connectivity))
    sizes = np.bincount(holes)
    ends = [[one for one in found if one.dimension == dimension] for dimension in range(3)]
    trees = [cKDTree([one.voxel for one in own]) if own else None for own in ends]
    patches = []
    for voxels in groups:
        counts = _filled_by(solid, voxels, parts, holes, sizes, around, connectivity)
        index = np.stack(np.unravel_index(voxels, solid.shape), axis=1)
        filled = [
            one
            for count, own, tree in zip(counts, ends, trees, strict=True)
            if count > 0 and tree is not None
            for one in _nearest(own, tree, index, count)
        ]
        if len(filled) == sum(map(abs, counts)):
            patches.append(Patch(voxels, tuple(filled)))
    return patches


def _layers(
    solid: Booleans, work: Counts, places: Integers, cost: Floats | None, around: Integers, connectivity: int
) -> list[Indices]:
    """The voxels (N,) of each component of what is left when all that is simple has shrunk back.

    Costly voxels shrink back first, then those far from some places (M, 3). The middles of what is left are better
    places, from which fewer are left; the best of some rounds is taken.
    """
    grown = np.flatnonzero(work.astype(bool) & ~solid.ravel())
    index = np.stack(np.unravel_index(grown, solid.shape), axis=1)
    price = np.ones(len(grown)) if cost is None else cost.ravel()[grown]
    best: tuple[float, list[Indices]] = (np.inf, [])
    for _ in range(_ROUNDS):
        away = cKDTree(places).query(index)[0]
        left = work.copy()
        grow(left, grown[np.lexsort((-away, -price))], around, connectivity)
        rows = np.flatnonzero(left[grown])
        mask = np.zeros(solid.shape, dtype=bool)
        mask.ravel()[grown[rows]] = True
        names, count = label(mask, _CORNERS)
        names = names.ravel()[grown[rows]]
        groups = [grown[rows[names == name]] for name in range(1, count + 1)]
        if (total := float(price[rows].sum())) >= best[0]:
            break
        best = total, groups
        places = np.stack([index[rows[names == name]].mean(axis=0) for name in range(1, count + 1)])
    return best[1]


def _nearest(filled: list[Filled], tree: cKDTree, index: Integers, count: int) -> list[Filled]:
    """As many places where classes end as a patch with voxels (N, 3) fills, the nearest first."""
    away, nearest = tree.query(index)
    closest = nearest[np.argsort(away, kind="stable")]
    first = np.sort(np.unique(closest, return_index=True)[1])
    return [filled[k] for k in np.resize(closest[first], count)]


def _filled_by(
    solid: Booleans,
    voxels: Indices,
    parts: Integers,
    holes: Integers,
    sizes: Integers,
    around: Integers,
    connectivity: int,
) -> tuple[int, int, int]:
    """How many parts some voxels join, tunnels they close and cavities they fill, if they alone join the solid.

    Parts and cavities follow from the labels around and within, tunnels from the Euler characteristic, which is local.
    """
    steps = around[_STEPS == 1] if connectivity == 6 else around
    touched = np.unique(parts[(voxels[:, None] + steps).ravel()])
    joined = int((touched > 0).sum()) - 1
    names, counts = np.unique(holes[voxels], return_counts=True)
    cavities = int((sizes[names] == counts).sum())
    at = np.unravel_index(voxels, solid.shape)
    box = tuple(slice(int(one.min()) - 1, int(one.max()) + 2) for one in at)
    after = solid[box].copy()
    after[tuple(one - side.start for one, side in zip(at, box, strict=True))] = True
    change = solid_euler(after, connectivity=connectivity) - solid_euler(solid[box], connectivity=connectivity)
    return joined, int(change) + joined + cavities, cavities
