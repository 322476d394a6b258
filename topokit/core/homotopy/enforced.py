"""A solid with wanted Betti numbers near another one: few voxels differ.

Two searches compete. One shifts the level of a field, see `nearest_solid`. The other is for one piece without tunnels
and cavities, and finds such a solid always: the deepest voxel grows into the solid, deep voxels first, as long as the
topology stays that of a ball. Growth stops where fronts meet, which is at thin places, and leaves gaps one voxel wide.
To fill narrow tunnels rather than to cut thick handles, it grows into the solid with these filled, too: the solid
grown by some voxels and shrunk again without changing its topology.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from topokit.core.arrays import Booleans
from topokit.core.homotopy.deformation import deform
from topokit.core.homotopy.nearest_solid import Betti, Change, cost, nearest_solid

Values = NDArray[np.float32]
Spacing = tuple[float, float, float]

_MARGIN = 4  # voxels around the solid within which it may be changed
_REACHES = (0.0, 1.0, 2.0, 4.0)  # by which the solid is grown before it is shrunk again, in voxels
_STAGES = 12  # of growth, from the deepest voxels to those at the surface


def enforced(
    inside: Booleans, field: Values | None, betti: Betti, change: Change, connectivity: int, spacing: Spacing
) -> Booleans | None:
    """The solid with given Betti numbers near another one; None if the search finds none.

    Args:
        inside: (X, Y, Z), the solid; not empty.
        field: (X, Y, Z), positive inside, finite: how much it costs to change a voxel. None for a binary volume: then
            the distance to the surface is taken, so that thin places are cut and narrow ones filled.
        betti: wanted numbers of pieces, tunnels and cavities.
        change: whether voxels may be added, removed or both.
        connectivity: 6 or 26, that of the solid.
        spacing: size of a voxel along each axis.
    """
    box = _box(inside)
    part = inside[box]
    values = signed_depth(part, spacing) if field is None else np.ascontiguousarray(field[box])
    found = [nearest_solid(values, betti, change, connectivity)]
    if betti == (1, 0, 0) and change != "add":
        depth = signed_depth(part, spacing)
        reaches = _REACHES if change == "any" else _REACHES[:1]
        found += [_ball_like(part, depth, reach * min(spacing), connectivity) for reach in reaches]
    best = min((one for one in found if one is not None), key=lambda one: cost(values, one), default=None)
    if best is None:
        return None
    solid = np.zeros_like(inside)
    solid[box] = best
    return solid


def _ball_like(inside: Booleans, depth: Values, reach: float, connectivity: int) -> Booleans:
    """A solid of one piece without tunnels and cavities that differs little from another one.

    Args:
        inside: (X, Y, Z), the solid.
        depth: its signed depth.
        reach: by which the solid is grown and shrunk again first, in units of the depth.
        connectivity: 6 or 26, that of the solid.
    """
    filled = deform(depth >= -reach, inside, connectivity) if reach else inside
    order = signed_depth(filled, (1.0, 1.0, 1.0)) if reach else depth
    solid = np.zeros_like(inside)
    solid[np.unravel_index(int(order.argmax()), order.shape)] = True
    for level in np.unique(np.quantile(order[filled], np.linspace(0, 1, _STAGES)))[::-1]:
        solid = deform(solid, filled & (order >= level), connectivity)
    return deform(solid, inside, connectivity)


def signed_depth(inside: Booleans, spacing: Spacing) -> Values:
    """Distances (X, Y, Z) of voxels to the nearest voxel on the other side, negative outside."""
    depth = distance_transform_edt(inside, spacing) - distance_transform_edt(~inside, spacing)
    return np.asarray(depth, dtype=np.float32)


def _box(inside: Booleans) -> tuple[slice, ...]:
    """The box of the solid with a margin, cut at the border of the volume."""
    slices = []
    for axis in range(3):
        found = np.flatnonzero(inside.any(tuple(other for other in range(3) if other != axis)))
        slices.append(slice(max(found[0] - _MARGIN, 0), found[-1] + 1 + _MARGIN))
    return tuple(slices)
