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
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label
from scipy.spatial import cKDTree

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.grid.euler import dual_connectivity, solid_euler
from topokit.core.homotopy.growth import Ranks, grow, joins, numbers_at, strides_around
from topokit.core.homotopy.simple_points import Counts, Indices
from topokit.core.labels import connected_labels

Labels = NDArray[np.int32]

_CORNERS = np.ones((3, 3, 3), dtype=bool)

_ROUNDS = 4  # of shrinking back
_NEAR = 16.0  # voxels around a place that shrink back in the best order rather than the fastest

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


class Regions(NamedTuple):
    """Connected components in a solid and around it.

    Attributes:
        parts: (X, Y, Z) labels of the components of the solid, from 1 on.
        holes: (X, Y, Z) those of the background.
    """

    parts: Labels
    holes: Labels


def regions(solid: Booleans, connectivity: int) -> Regions:
    """The components of a solid (X, Y, Z) and of its background."""
    return Regions(_labels(solid, connectivity), _labels(~solid, dual_connectivity(connectivity)))


def closing(
    solid: Booleans,
    known: Regions,
    layer: tuple[Indices, Ranks],
    widths: Widths,
    wanted: Callable[[int, Floats], Booleans],
    cost: Floats | None,
    connectivity: int,
) -> list[Patch]:
    """The patches that fill gaps, tunnels and cavities of a solid; any choice of them may be applied.

    Args:
        solid: (X, Y, Z), with a layer around it that is not changed.
        known: its components.
        layer: the voxels that may be filled, see `layer_around`.
        widths: of places, given by their indices (M, 3).
        wanted: which classes of a dimension and of some widths (M,) are filled.
        cost: (X, Y, Z), what it costs to fill each voxel; None if all cost the same.
        connectivity: 6 or 26, that of the solid.
    """
    around = strides_around(solid.shape)
    work = solid.astype(np.int8).ravel()
    voxels, rank = layer
    waiting, tried = voxels, (voxels[:0],) * 3
    found: list[Filled] = []
    while True:
        grow(work, waiting[work[waiting] == 0], rank, around, connectivity)
        waiting = waiting[work[waiting] == 0]
        candidates = _candidates(work, waiting, around, connectivity)
        if all(np.isin(*pair).all() for pair in zip(candidates, tried, strict=True)):
            break
        tried = candidates
        new = []
        for dimension, ends in enumerate(_ends(work, candidates, solid.shape, around, connectivity)):
            places = np.stack(np.unravel_index(ends, solid.shape), axis=1)
            sizes = widths(places) if len(places) else np.empty(0)
            rows = np.flatnonzero(wanted(dimension, sizes))
            new += [(int(ends[k]), Filled(dimension, places[k], float(sizes[k]))) for k in rows]
        filled = [one for voxel, one in new if _fills(work, voxel, one.dimension, around, connectivity)]
        if not filled:
            break
        found += filled
    grown = voxels[work[voxels] != 0]
    return _patches(solid, known, work, grown, rank, found, cost, connectivity) if found else []


def _candidates(
    work: Counts, waiting: Indices, around: Integers, connectivity: int
) -> tuple[Indices, Indices, Indices]:
    """Voxels that join what is apart or close a loop, that close a tunnel or wall off a cavity, and that fill one."""
    solid, background = numbers_at(work, waiting, around, connectivity)
    one = solid == 1
    return waiting[(solid > 1) & (background == 1)], waiting[one & (background > 1)], waiting[one & (background == 0)]


def _ends(
    work: Counts,
    candidates: tuple[Indices, Indices, Indices],
    shape: tuple[int, ...],
    around: Integers,
    connectivity: int,
) -> tuple[Indices, Indices, Indices]:
    """Those candidates at which a class of each dimension ends, in the order of their distance."""
    between, across, last = candidates
    if len(between):
        parts = _labels(work.reshape(shape), connectivity).ravel()
        between = between[joins(work.copy(), parts, between, around, connectivity) > 1]
    if len(across):
        rest = 1 - work
        rest[across] = 0
        holes = _labels(rest.reshape(shape), dual_connectivity(connectivity)).ravel()
        closes = joins(rest, holes, across[::-1], around, dual_connectivity(connectivity)) < 0
        across = across[::-1][closes]
    return between, across, last


def _labels(mask: Counts | Booleans, connectivity: int) -> Labels:
    return np.asarray(label(mask, _CORNERS if connectivity == 26 else None)[0], dtype=np.int32)


def _fills(work: Counts, voxel: int, dimension: int, around: Integers, connectivity: int) -> bool:
    """Fill a voxel if it still ends a class of that dimension, now that others have been filled."""
    solid, background = (int(one[0]) for one in numbers_at(work, np.array([voxel]), around, connectivity))
    is_end = (solid > 1 and background == 1, solid == 1 and background > 1, solid == 1 and background == 0)[dimension]
    if is_end:
        work[voxel] = 1
    return is_end


def _patches(
    solid: Booleans,
    known: Regions,
    work: Counts,
    grown: Indices,
    rank: Ranks,
    found: list[Filled],
    cost: Floats | None,
    connectivity: int,
) -> list[Patch]:
    """What is left of the growth when it has shrunk back, with what each patch fills."""
    ends = [[one for one in found if one.dimension == dimension] for dimension in range(3)]
    trees = [cKDTree([one.voxel for one in own]) if own else None for own in ends]
    price = np.ones(len(grown)) if cost is None else cost.ravel()[grown]
    patches = []
    for voxels in _layers(work, solid.shape, grown, rank, np.stack([one.voxel for one in found]), price, connectivity):
        counts = _filled_by(solid, voxels, known, connectivity)
        index = np.stack(np.unravel_index(voxels, solid.shape), axis=1)
        filled = [
            one
            for count, own, tree in zip(counts, ends, trees, strict=True)
            if count > 0 and tree is not None
            for one in _nearest(own, tree, index, count)
        ]
        if filled and len(filled) == sum(map(abs, counts)):
            patches.append(Patch(voxels, tuple(filled)))
    return patches


def _layers(
    work: Counts,
    shape: tuple[int, ...],
    grown: Indices,
    rank: Ranks,
    places: Integers,
    price: Floats,
    connectivity: int,
) -> list[Indices]:
    """The voxels (N,) of each component of what is left when all that is simple has shrunk back.

    What grew last shrinks back first, as far as it is simple. Of the rest costly voxels come first, then those far from
    some places (M, 3). The middles of what is left are better places, from which fewer are left; the best of some
    rounds is taken.
    """
    around = strides_around(shape)
    away = cKDTree(places).query(np.stack(np.unravel_index(grown, shape), axis=1), distance_upper_bound=_NEAR)[0]
    is_near = np.isfinite(away)
    grow(work, grown[~is_near][::-1], rank, around, connectivity)
    stays = np.flatnonzero(work[grown])
    stays = stays[np.argsort(grown[stays])]
    grown, price = grown[stays], price[stays]
    index = np.stack(np.unravel_index(grown, shape), axis=1)
    best: tuple[float, list[Indices]] = (np.inf, [])
    for _ in range(_ROUNDS):
        away = cKDTree(places).query(index)[0]
        grow(work, grown[np.lexsort((-away, -price))], rank, around, connectivity)
        rows = np.flatnonzero(work[grown])
        work[grown] = 1
        groups = [rows[group] for group in _touching(index[rows])]
        if (total := float(price[rows].sum())) >= best[0]:
            break
        best = total, [grown[group] for group in groups]
        places = np.stack([index[group].mean(axis=0) for group in groups])
    return best[1]


def _touching(index: Integers) -> list[Integers]:
    """The rows of each component of some voxels (N, 3), joined by faces, edges and corners."""
    pairs = cKDTree(index).query_pairs(1.0, p=np.inf, output_type="ndarray")
    names = connected_labels(len(index), *pairs.T)
    return np.split(np.argsort(names, kind="stable"), np.cumsum(np.bincount(names))[:-1])


def _nearest(filled: list[Filled], tree: cKDTree, index: Integers, count: int) -> list[Filled]:
    """As many places where classes end as a patch with voxels (N, 3) fills, the nearest first."""
    away, nearest = tree.query(index)
    closest = nearest[np.argsort(away, kind="stable")]
    first = np.sort(np.unique(closest, return_index=True)[1])
    return [filled[k] for k in np.resize(closest[first], count)]


def _filled_by(solid: Booleans, voxels: Indices, known: Regions, connectivity: int) -> tuple[int, int, int]:
    """How many parts some voxels join, tunnels they close and cavities they fill, if they alone join the solid.

    Parts and cavities follow from the labels around and within, tunnels from the Euler characteristic, which is local.
    """
    at = np.unravel_index(voxels, solid.shape)
    box = tuple(slice(int(one.min()) - 1, int(one.max()) + 2) for one in at)
    added = np.zeros([side.stop - side.start for side in box], dtype=bool)
    added[tuple(one - side.start for one, side in zip(at, box, strict=True))] = True
    own, other = (None, _CORNERS) if connectivity == 6 else (_CORNERS, None)
    touched = known.parts[box][binary_dilation(added, own)]
    joined = len(np.unique(touched[touched > 0])) - 1
    holes = known.holes[box]
    beside = holes[binary_dilation(added, other) & ~added]
    cavities = len(np.setdiff1d(holes[added], beside))
    change = solid_euler(solid[box] | added, connectivity=connectivity) - solid_euler(
        solid[box], connectivity=connectivity
    )
    return joined, int(change) + joined + cavities, cavities
