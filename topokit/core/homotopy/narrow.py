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
from topokit.core.homotopy.bits import Bits, packed, voxels_of, widened
from topokit.core.homotopy.growth import strides_around
from topokit.core.homotopy.simple_points import OFFSETS, Counts, code_at, n_touching

_HALF = 0.87  # voxels from a center to the corners
_EQUAL = 0.3  # voxels by which they are as near
_FARTHEST = 8  # voxels to look at in each direction; for greater widths the whole volume costs less
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
        return _inner(np.arange(solid.size), solid.shape, around)
    rings = np.zeros(solid.shape, dtype=np.int8)
    for own, joined in ((solid, connectivity), (~solid, dual_connectivity(connectivity))):
        voxels, distances = narrow_voxels(own, reach, spacing, joined)
        rings.ravel()[voxels] = np.maximum(rings.ravel()[voxels], np.ceil(distances / min(spacing)))
    found = packed(np.zeros_like(solid))
    for ring in range(1, int(rings.max()) + 1):
        bits = packed(rings == ring)
        for axis, step in enumerate(spacing):
            size = int(np.ceil(ring * min(spacing) / step))
            bits = widened(bits, axis, size, size)
        found |= bits
    return _inner(voxels_of(found, solid.shape[2]), solid.shape, around)


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
    x, y, z = (int((reach + step / 2) / step) for step in spacing)
    voxels = _inner(voxels_of(_between(packed(solid), (x, y, z)), solid.shape[2]), solid.shape, margins(reach, spacing))
    inside = solid.ravel().view(np.int8)
    half, equal = _HALF * max(spacing), _EQUAL * max(spacing)
    sights = _sights(solid.shape, reach + half, spacing, np.zeros(3))
    is_near, nearest = _surrounded(inside, voxels, *sights, 0.0, 2 * half, equal)
    chosen = _meeting(inside, voxels, strides_around(solid.shape), connectivity) & np.isfinite(nearest)
    for shift in product((0.0, 0.5), repeat=3):
        least = float(np.linalg.norm(spacing)) / 2 if any(shift) else max(spacing)  # nearer ones are where voxels meet
        rows = np.flatnonzero(is_near & ~chosen)
        sights = _sights(solid.shape, reach + half, spacing, np.array(shift))
        chosen[rows] = _surrounded(inside, voxels[rows], *sights, least + _LEVEL, equal, equal)[0]
    return voxels[chosen], nearest[chosen]


def _inner(voxels: Integers, shape: tuple[int, ...], layers: tuple[int, int, int]) -> Integers:
    """Those voxels (N,) that are in none of some layers around a volume."""
    is_inner = np.ones(len(voxels), dtype=bool)
    for at, n, size in zip(np.unravel_index(voxels, shape), layers, shape, strict=True):
        is_inner &= (at >= n) & (at < size - n)
    return voxels[is_inner]


def _between(solid: Bits, around: tuple[int, int, int]) -> Bits:
    """The background that has the solid on both sides along each axis, in half boxes around it."""
    along_z = widened(solid, 2, around[2], around[2])
    along_y = widened(solid, 1, around[1], around[1])
    across_x, across_y = widened(along_z, 1, around[1], around[1]), widened(along_z, 0, around[0], around[0])
    found = ~solid
    for axis, plane in enumerate((across_x, across_y, widened(along_y, 0, around[0], around[0]))):
        found &= widened(plane, axis, around[axis], 0) & widened(plane, axis, 0, around[axis])
    return found


def _sights(
    shape: tuple[int, ...], reach: float, spacing: tuple[float, float, float], shift: Floats
) -> tuple[Integers, Floats, Masks, Masks]:
    """Steps to the voxels around one, the nearest first, their distances, and which directions they are in.

    Directions are those to the 26 neighbors, a bit each: once those with an angle of at most 90° to the step, once
    those with less. Distances and directions are seen from the voxel's center, shifted by a part of the voxel (3,).
    """
    sides = [np.arange(-n, n + 1) for n in margins(reach, spacing)]
    offsets = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    seen = (offsets - shift) * spacing
    distances = np.linalg.norm(seen, axis=1)
    near = offsets.any(axis=1) & (distances <= reach)
    order = np.flatnonzero(near)[np.argsort(distances[near], kind="stable")]
    offsets, seen, distances = offsets[order], seen[order], distances[order]
    ways = OFFSETS[OFFSETS.any(axis=1)] * np.array(spacing)
    cosines = seen @ (ways / np.linalg.norm(ways, axis=1)[:, None]).T / distances[:, None]
    bits = 1 << np.arange(len(ways))
    beside, ahead = ((chosen @ bits).astype(np.int32) for chosen in (cosines >= -_LEVEL, cosines > _LEVEL))
    return offsets @ np.array([shape[1] * shape[2], shape[2], 1]), distances, beside, ahead


@compiled
def _surrounded(
    solid: Counts,
    voxels: Integers,
    steps: Integers,
    distances: Floats,
    beside: Masks,
    ahead: Masks,
    least: float,
    slack: float,
    equal: float,
) -> tuple[Booleans, Floats]:
    """Whether the points of the solid that are nearest to each voxel, or nearly so, lie in all directions; how near."""
    found, away = np.zeros(len(voxels), dtype=np.bool_), np.full(len(voxels), np.inf)
    everywhere = (1 << 26) - 1
    for row in range(len(voxels)):
        nearest, directions = -1.0, 0
        for k in range(len(steps)):
            distance = distances[k]
            if 0 < nearest < distance - slack:
                break
            if solid[voxels[row] + steps[k]]:
                if nearest < 0:
                    if distance < least:
                        break
                    nearest = away[row] = distance
                directions |= beside[k] if distance <= nearest + equal else ahead[k]
                if directions == everywhere:
                    found[row] = True
                    break
    return found, away


@compiled
def _meeting(solid: Counts, voxels: Integers, around: Integers, connectivity: int) -> Booleans:
    """Whether each voxel touches the solid in several places, or several regions of the background."""
    found = np.zeros(len(voxels), dtype=np.bool_)
    for row in range(len(voxels)):
        code = code_at(solid, voxels[row], around)
        if code:
            found[row] = n_touching(code, connectivity) > 1 or n_touching(~code & 0x7FFFFFF, 32 - connectivity) != 1
    return found
