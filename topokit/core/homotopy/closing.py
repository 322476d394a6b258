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

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.grid.euler import dual_connectivity
from topokit.core.homotopy.effects import effect
from topokit.core.homotopy.growth import Nodes, Ranks, grow, numbers_at
from topokit.core.homotopy.layer import Layer
from topokit.core.homotopy.simple_points import Counts, Indices
from topokit.core.homotopy.zone import Zone, joins
from topokit.core.labels import connected_labels

_ROUNDS = 4  # of shrinking back
_NEAR = 16  # voxels around a place, at least, that shrink back in the best order rather than the fastest

_NONE: Nodes = np.empty(0, dtype=np.int32)  # forest that is not needed

Shape = tuple[int, ...]
Widths = Callable[[Integers], Floats]
Candidates = tuple[Indices, Indices, Indices]
Forests = tuple[Nodes, Nodes]


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


class Growth(NamedTuple):
    """A solid that grows within a zone, and memory to work in.

    Attributes:
        own: (M,) 1 in the solid, flat; the same again after each use.
        shape: (X, Y, Z) of the volume.
        zone: where voxels may be filled.
        ranks: (K,) −1, of the zone's nodes; the same again after each use.
        connectivity: 6 or 26, that of the solid.
    """

    own: Counts
    shape: Shape
    zone: Zone
    ranks: Ranks
    connectivity: int


def closing(
    growth: Growth,
    known: Forests,
    layer: Layer,
    widths: Widths,
    wanted: Callable[[int, Floats], Booleans],
    cost: Floats | None,
) -> tuple[list[Patch], list[Filled]]:
    """The patches that fill gaps, tunnels and cavities of a solid; any choice of them may be applied.

    Args:
        growth: the solid.
        known: forests of the solid and of its background; see `Zone.forest`. Of a block, regions of the solid that
            reach where the volume goes on are joined, those of the background are not: what is filled then is settled
            whatever is there.
        layer: the voxels that may be filled, see `layer_around`.
        widths: of places, given by their indices (N, 3).
        wanted: which classes of a dimension and of some widths (N,) are filled.
        cost: (M,), what it costs to fill each voxel; None if all cost the same.

    Returns:
        The patches, and places of a block that might be filled, depending on what is beyond it.
    """
    own, shape, zone, _, connectivity = growth
    found, unsettled = _filled(growth, known, layer, widths, wanted)
    places = np.array([one.voxel for one in found], dtype=np.int64).reshape(-1, 3)
    grown = layer.voxels[own[layer.voxels] != 0]
    grown = grown[zone.are_with(grown, np.atleast_1d(np.ravel_multi_index(tuple(places.T), shape)))]
    price = np.ones(len(grown)) if cost is None else cost[grown]
    groups = _layers(growth, grown, places, price) if found else []
    own[layer.voxels] = 0
    kinds = [[one for one in found if one.dimension == dimension] for dimension in range(3)]
    trees = [cKDTree([one.voxel for one in same]) if same else None for same in kinds]
    patches = []
    for voxels in groups:
        counts = effect(own, voxels, zone.nodes, *known, zone.around, connectivity)
        index = np.stack(np.unravel_index(voxels, shape), axis=1)
        filled = [
            one
            for count, same, tree in zip(counts, kinds, trees, strict=True)
            if count > 0 and tree is not None
            for one in _nearest(same, tree, index, count)
        ]
        if filled and len(filled) == sum(map(abs, counts)):
            patches.append(Patch(voxels, tuple(filled)))
    return patches, unsettled


def _filled(
    growth: Growth, known: Forests, layer: Layer, widths: Widths, wanted: Callable[[int, Floats], Booleans]
) -> tuple[list[Filled], list[Filled]]:
    """Let the solid grow and fill what is wanted, until no class ends any more; and what is not settled in a block."""
    own, shape, zone, ranks, connectivity = growth
    own[layer.voxels] = 1
    beyond = zone.forest(own, 0, dual_connectivity(connectivity))
    own[layer.voxels] = 0
    parts = known[0].copy()
    waiting, tried = layer, (layer.voxels[:0],) * 3
    found: list[Filled] = []
    while True:
        waiting = waiting.those(own[waiting.voxels] == 0)
        grow(own, waiting.voxels, zone.nodes, ranks, zone.around, connectivity, parts)
        waiting = waiting.those(own[waiting.voxels] == 0)
        candidates = _candidates(growth, waiting)
        if all(np.isin(*pair).all() for pair in zip(candidates, tried, strict=True)):
            break
        tried = candidates
        new = _wanted(_ends(growth, (parts, beyond), waiting.voxels, candidates), shape, widths, wanted)
        filled = [one for voxel, one in new if _fills(growth, parts, voxel, one.dimension)]
        if not filled:
            break
        found += filled
    others = _unsettled(growth, (parts, beyond), waiting.voxels, candidates) if zone.is_open else ()
    return found, [one for _, one in _wanted(others, shape, widths, wanted)]


def _wanted(
    ends: Iterable[Indices], shape: Shape, widths: Widths, wanted: Callable[[int, Floats], Booleans]
) -> list[tuple[int, Filled]]:
    """Those voxels at which classes of each dimension end that are to be filled, and what that fills."""
    found = []
    for dimension, voxels in enumerate(ends):
        places = np.stack(np.unravel_index(voxels, shape), axis=1)
        sizes = widths(places) if len(places) else np.empty(0)
        rows = np.flatnonzero(wanted(dimension, sizes))
        found += [(int(voxels[k]), Filled(dimension, places[k], float(sizes[k]))) for k in rows]
    return found


def _candidates(growth: Growth, waiting: Layer) -> Candidates:
    """Voxels that join what is apart or close a loop, that close a tunnel or wall off a cavity, and that fill one."""
    solid, background = numbers_at(growth.own, waiting.voxels, growth.zone.around, growth.connectivity)
    one = solid == 1
    kinds = (solid > 1) & (background == 1), one & (background > 1), one & (background == 0)
    between, across, last = map(waiting.in_order, kinds)
    return between, across, last


def _ends(growth: Growth, rest: Forests, waiting: Indices, candidates: Candidates) -> Candidates:
    """Those candidates at which a class of each dimension ends, in the order of their distance.

    Args:
        growth: the grown solid.
        rest: forests of the solid and of its background without the layer.
        waiting: voxels of the layer that are not in the solid.
        candidates: for each dimension.
    """
    own, _, zone, _, connectivity = growth
    (parts, holes), (between, across, last) = (one.copy() for one in rest), candidates
    if len(between):
        joined = joins(own, 1, zone.nodes, parts, between, zone.around, connectivity)
        own[between] = 0
        between = between[joined > 1]
    if len(across):
        dual = dual_connectivity(connectivity)
        own[across] = 1
        zone.join(holes, own, 0, waiting, dual)
        joined = joins(own, 0, zone.nodes, holes, across[::-1].copy(), zone.around, dual)
        own[across] = 0
        across = across[::-1][joined < 0]
    return between, across, last


def _unsettled(growth: Growth, rest: Forests, waiting: Indices, candidates: Candidates) -> tuple[Indices, Indices]:
    """Other candidates than those of `_ends` at which a class would end if what is beyond the block were otherwise."""
    own, _, zone, _, connectivity = growth
    otherwise = zone.forest(own, 1, connectivity), zone.with_outside(rest[1], own, 0)
    settled = _ends(growth, rest, waiting, candidates)
    others = _ends(growth, otherwise, waiting, candidates)
    between, across = (one[~np.isin(one, known)] for one, known in zip(others[:2], settled[:2], strict=True))
    return between, across


def _fills(growth: Growth, parts: Nodes, voxel: int, dimension: int) -> bool:
    """Fill a voxel if it still ends a class of that dimension, now that others have been filled."""
    own, _, zone, _, connectivity = growth
    at = np.array([voxel])
    solid, background = (int(one[0]) for one in numbers_at(own, at, zone.around, connectivity))
    is_end = (solid > 1 and background == 1, solid == 1 and background > 1, solid == 1 and background == 0)[dimension]
    if is_end:
        own[voxel] = 1
        zone.join(parts, own, 1, at, connectivity)
    return is_end


def _layers(growth: Growth, grown: Indices, places: Integers, price: Floats) -> list[Indices]:
    """The voxels (N,) of each component of what is left when all that is simple has shrunk back.

    What grew last shrinks back first, as far as it is simple. Of the rest costly voxels come first, then those far from
    some places (P, 3). The middles of what is left are better places, from which fewer are left; the best of some
    rounds is taken.
    """
    own, shape, zone, ranks, connectivity = growth
    index = np.stack(np.unravel_index(grown, shape), axis=1)
    grow(own, grown[~_is_near(index, places, shape)][::-1].copy(), zone.nodes, ranks, zone.around, connectivity, _NONE)
    stays = np.flatnonzero(own[grown])
    stays = stays[np.argsort(grown[stays])]
    grown, price, index = grown[stays], price[stays], index[stays]
    best: tuple[float, list[Indices]] = (np.inf, [])
    for _ in range(_ROUNDS):
        away = cKDTree(places).query(index)[0]
        grow(own, grown[np.lexsort((-away, -price))], zone.nodes, ranks, zone.around, connectivity, _NONE)
        rows = np.flatnonzero(own[grown])
        own[grown] = 1
        groups = [rows[group] for group in _touching(index[rows])]
        if (total := float(price[rows].sum())) >= best[0]:
            break
        best = total, [grown[group] for group in groups]
        places = np.stack([index[group].mean(axis=0) for group in groups])
    return best[1]


def _is_near(index: Integers, places: Integers, shape: Shape) -> Booleans:
    """Which voxels (N, 3) are in the tile of one of some places (P, 3), or in one beside it."""
    has_place = np.zeros([size // _NEAR + 1 for size in shape], dtype=bool)
    has_place[tuple((places // _NEAR).T)] = True
    beside: Booleans = binary_dilation(has_place, np.ones((3, 3, 3)))
    return beside[tuple((index // _NEAR).T)]


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
