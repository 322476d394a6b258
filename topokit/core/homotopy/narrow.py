"""Where the background of a solid may be narrow: at voxels with the solid all around them, about equally near.

A class of homology of the solid's growth ends at a critical point of the distance from it. There the nearest points of
the solid lie in no half of space alone. A wall, an edge or a slope has them on one side, so most of the surface is left
out by a few passes over the volume, and the rest by a look at the voxels around.

Reference:
    K. Grove, "Critical point theory for distance functions", Proc. Symp. Pure Math. 54.3, 1993.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.grid.euler import dual_connectivity
from topokit.core.homotopy.bits import WORD, Bits, of_voxels, packed, voxels_of, widened
from topokit.core.homotopy.growth import strides_around
from topokit.core.homotopy.simple_points import OFFSETS, Counts, code_at, exchanged, n_touching

_HALF = 0.87  # voxels from a center to the corners
_EQUAL = 0.3  # voxels by which they are as near
_FARTHEST = 8  # voxels to look at in each direction; for greater widths the whole volume costs less
_TOGETHER = 256  # words, of which all that is around stays in the cache
_LEVEL = 1e-6  # cosine up to which a point counts as beside, neither ahead nor behind

Masks = NDArray[np.int32]


def margins(reach: float, spacing: tuple[float, float, float]) -> tuple[int, int, int]:
    """How many voxels around a volume are looked at along each axis; see `narrow_voxels`."""
    x, y, z = (int(np.ceil((reach + _HALF * max(spacing)) / step)) for step in spacing)
    return x, y, z


def around_narrow_places(
    solid: Booleans, reach: float, spacing: tuple[float, float, float], connectivity: int
) -> Integers:
    """The voxels around narrow places of a solid and of its background, as far from each as the other side is.

    Args:
        solid: (X, Y, Z), with as many layers around what matters as `margins` says, which are left out.
        reach: largest distance from the other side.
        spacing: size of a voxel along each axis.
        connectivity: 6 or 26, that of the solid.

    Returns:
        (N,) flat indices, ascending; all but the layers if the reach is so long that looking for them costs more.
    """
    around = margins(reach, spacing)
    if max(around) > _FARTHEST:
        return voxels_of(_without_layers(solid.shape, around), solid.shape[2])
    bits = packed(solid)
    voxels, rings = [], []
    for phase, joined in ((True, connectivity), (False, dual_connectivity(connectivity))):
        own = bits if phase else ~bits
        at, distances = _narrow_voxels(solid, phase, own, reach, spacing, joined)
        voxels.append(at)
        rings.append(np.ceil(distances / min(spacing)).astype(np.int64))
    ring = np.concatenate(rings)
    found = np.zeros_like(bits)
    for steps in np.unique(ring).tolist():
        ends = of_voxels(np.concatenate(voxels)[ring == steps], solid.shape)
        for axis, step in enumerate(spacing):
            size = int(np.ceil(steps * min(spacing) / step))
            ends = widened(ends, axis, size, size)
        found |= ends
    return voxels_of(found & _without_layers(solid.shape, around), solid.shape[2])


def narrow_voxels(
    solid: Booleans, reach: float, spacing: tuple[float, float, float], connectivity: int
) -> tuple[Integers, Floats]:
    """The voxels of the background at which a class of the solid's growth may end.

    Args:
        solid: (X, Y, Z), with as many layers around what matters as `margins` says, which are left out.
        reach: largest distance from the solid.
        spacing: size of a voxel along each axis.
        connectivity: 6 or 26, that of the solid.

    Returns:
        (N,) flat indices, and distances from the solid.
    """
    return _narrow_voxels(solid, True, packed(solid), reach, spacing, connectivity)


def _narrow_voxels(
    solid: Booleans, phase: bool, own: Bits, reach: float, spacing: tuple[float, float, float], connectivity: int
) -> tuple[Integers, Floats]:
    """Those of a solid, or of its background if the phase is False, whose voxels are also given as bits."""
    inside, length = solid.ravel().view(np.int8), solid.shape[2]
    half, equal = _HALF * max(spacing), _EQUAL * max(spacing)
    inner = _without_layers(solid.shape, margins(reach, spacing))
    x, y, z = (int((reach + step / 2) / step) for step in spacing)
    between = _between(own, (x, y, z)) & inner
    sights = _sights(solid.shape, reach + half, spacing, np.zeros((1, 3)))
    anywhere = np.zeros(1)
    beside = own
    for axis in range(3):
        beside = widened(beside, axis, 1, 1)
    meeting = _meeting(inside, phase, voxels_of(between & beside, length), strides_around(solid.shape), connectivity)
    away = _surrounded(inside, phase, meeting, *sights, anywhere, 2 * half, equal)[1]
    is_near = np.isfinite(away)
    meeting, away = meeting[is_near], away[is_near]
    enclosed = _enclosed(own, between & ~of_voxels(meeting, solid.shape), reach + half, spacing)
    voxels = voxels_of(enclosed, length)
    is_near, nearest = _surrounded(inside, phase, voxels, *sights, anywhere, 2 * half, equal)
    voxels, nearest = voxels[is_near], nearest[is_near]
    shifts = np.array(list(product((0.0, 0.5), repeat=3)))
    least = np.where(shifts.any(axis=1), np.linalg.norm(spacing) / 2, max(spacing))  # nearer ones are where voxels meet
    sights = _sights(solid.shape, reach + half, spacing, shifts)
    chosen = _surrounded(inside, phase, voxels, *sights, least + _LEVEL, equal, equal)[0]
    return np.concatenate((meeting, voxels[chosen])), np.concatenate((away, nearest[chosen]))


def _without_layers(shape: tuple[int, ...], layers: tuple[int, int, int]) -> Bits:
    """All voxels of a volume but those in some layers around it."""
    x, y, z = (slice(n, size - n) for n, size in zip(layers, shape, strict=True))
    row = np.zeros((1, 1, shape[2]), dtype=bool)
    row[0, 0, z] = True
    words = packed(row)
    inner = np.zeros((shape[0], shape[1], words.shape[2]), dtype=np.uint64)
    inner[x, y] = words
    return inner


def _between(solid: Bits, around: tuple[int, int, int]) -> Bits:
    """The background that has the solid on both sides along each axis, in half boxes around it."""
    along_z = widened(solid, 2, around[2], around[2])
    along_y = widened(solid, 1, around[1], around[1])
    across_x, across_y = widened(along_z, 1, around[1], around[1]), widened(along_z, 0, around[0], around[0])
    found = ~solid
    for axis, plane in enumerate((across_x, across_y, widened(along_y, 0, around[0], around[0]))):
        found &= widened(plane, axis, around[axis], 0) & widened(plane, axis, 0, around[axis])
    return found


def _steps_around(reach: float, spacing: tuple[float, float, float]) -> Integers:
    """Steps (N, 3) to all voxels that are looked at around one."""
    sides = [np.arange(-n, n + 1) for n in margins(reach, spacing)]
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)


def _half_balls(reach: float, spacing: tuple[float, float, float]) -> tuple[Integers, Integers, Integers]:
    """The halves of a ball around a voxel toward its neighbors across edges and corners.

    Returns:
        (N, 3), the steps to the voxels of the ball, the nearest first; the rows of those in each half, and (21,), where
        each half starts among these.
    """
    offsets = _steps_around(reach, spacing)
    lengths = np.linalg.norm(offsets * spacing, axis=1)
    offsets = offsets[np.argsort(lengths, kind="stable")][: int((lengths <= reach).sum())]
    ways = OFFSETS[abs(OFFSETS).sum(axis=1) > 1] * np.array(spacing)
    halves = [np.flatnonzero((offsets * spacing) @ (way / np.linalg.norm(way)) >= -_LEVEL) for way in ways]
    return offsets, np.concatenate(halves), np.cumsum([0, *map(len, halves)])


def _enclosed(solid: Bits, among: Bits, reach: float, spacing: tuple[float, float, float]) -> Bits:
    """Those of some voxels of the background that have the solid in every half of a ball around them."""
    offsets, halves, starts = _half_balls(reach, spacing)
    places = np.flatnonzero(among)
    steps = offsets @ np.array([solid.shape[1] * solid.shape[2], solid.shape[2], 0])
    found = np.zeros_like(solid)
    left = among.ravel()[places]
    _leave_enclosed(solid.ravel(), places, left, steps, offsets[:, 2], halves, starts)
    found.ravel()[places] = left
    return found


@compiled
def _leave_enclosed(
    solid: Bits, places: Integers, left: Bits, steps: Integers, ahead: Integers, halves: Integers, starts: Integers
) -> None:
    """Keep those bits of some words (N,) that see the solid in every half; many words at a time, without branches."""
    seen = np.empty((len(steps), _TOGETHER), dtype=np.uint64)
    here = np.empty(_TOGETHER, dtype=np.uint64)
    for first in range(0, len(places), _TOGETHER):
        n = min(_TOGETHER, len(places) - first)
        for k in range(len(steps)):
            near, far = np.uint64(abs(ahead[k])), np.uint64(WORD - abs(ahead[k]))
            for i in range(n):
                at = places[first + i] + steps[k]
                if ahead[k] > 0:
                    seen[k, i] = solid[at] >> near | solid[at + 1] << far
                elif ahead[k] < 0:
                    seen[k, i] = solid[at] << near | solid[at - 1] >> far
                else:
                    seen[k, i] = solid[at]
        for half in range(len(starts) - 1):
            here[:n] = 0
            for k in range(starts[half], starts[half + 1]):
                row = seen[halves[k]]
                for i in range(n):
                    here[i] |= row[i]
            for i in range(n):
                left[first + i] &= here[i]


def _sights(
    shape: tuple[int, ...], reach: float, spacing: tuple[float, float, float], shifts: Floats
) -> tuple[Integers, Floats, Masks, Masks]:
    """Steps to the voxels around one, the nearest first, their distances, and which directions they are in.

    Directions are those to the 26 neighbors, a bit each: once those with an angle of at most 90° to the step, once
    those with less. Distances and directions are seen from the voxel's center, shifted by a part of the voxel: each
    shift (S, 3) has a row (S, K) of its own. Those too far away are at the end, infinitely far.
    """
    offsets = _steps_around(reach, spacing)
    offsets = offsets[offsets.any(axis=1)]
    seen = (offsets - shifts[:, None]) * spacing
    distances = np.linalg.norm(seen, axis=2)
    distances[distances > reach] = np.inf
    order = np.argsort(distances, axis=1, kind="stable")
    distances = np.take_along_axis(distances, order, axis=1)
    ways = OFFSETS[OFFSETS.any(axis=1)] * np.array(spacing)
    along = np.take_along_axis(seen @ (ways / np.linalg.norm(ways, axis=1)[:, None]).T, order[:, :, None], axis=1)
    bits, level = 1 << np.arange(len(ways)), _LEVEL * distances[:, :, None]
    beside, ahead = ((chosen @ bits).astype(np.int32) for chosen in (along >= -level, along > level))
    return (offsets @ np.array([shape[1] * shape[2], shape[2], 1]))[order], distances, beside, ahead


@compiled
def _surrounded(
    solid: Counts,
    phase: int,
    voxels: Integers,
    steps: Integers,
    distances: Floats,
    beside: Masks,
    ahead: Masks,
    least: Floats,
    slack: float,
    equal: float,
) -> tuple[Booleans, Floats]:
    """Whether the points of a phase that are nearest to each voxel, or nearly so, lie in all directions; how near.

    One of several sights is enough; how near is that of the first. In each, no point may be nearer than some least
    distance (S,).
    """
    found, away = np.zeros(len(voxels), dtype=np.bool_), np.full(len(voxels), np.inf)
    everywhere = (1 << 26) - 1
    for row in range(len(voxels)):
        for sight in range(len(steps)):
            voxel, seen, near, k = voxels[row], steps[sight], distances[sight], 0
            while near[k] < np.inf and solid[voxel + seen[k]] != phase:
                k += 1
            nearest, directions = near[k], 0
            if sight == 0:
                away[row] = nearest
            if nearest < least[sight]:
                continue
            while near[k] < np.inf and near[k] <= nearest + equal:  # without branches: they would be mispredicted
                directions |= beside[sight, k] * (solid[voxel + seen[k]] == phase)
                k += 1
            while near[k] < np.inf and near[k] - slack <= nearest:
                directions |= ahead[sight, k] * (solid[voxel + seen[k]] == phase)
                k += 1
            if directions == everywhere:
                found[row] = True
                break
    return found, away


@compiled
def _meeting(solid: Counts, phase: int, voxels: Integers, around: Integers, connectivity: int) -> Integers:
    """Those of some voxels that touch a phase in several places, or several regions of the other one."""
    found = np.zeros(len(voxels), dtype=np.bool_)
    for row in range(len(voxels)):
        code = code_at(solid, voxels[row], around)
        if phase == 0:
            code = exchanged(code)
        if code:
            found[row] = n_touching(code, connectivity) > 1 or n_touching(exchanged(code), 32 - connectivity) != 1
    return voxels[found]
