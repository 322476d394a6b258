"""Solids in boxes whose ends are no ends: joined to the opposite ones, or cut out of a larger body.

In a periodic box M, a torus along its periodic axes and unbounded along the others, the Betti numbers of a solid K with
complement C follow from components and from winding: how often a loop goes around each periodic axis. With p periodic
axes, winding ranks r(K), r(C) and r of both together, and b3 = 1 only if K is a whole 3-torus,

    b2(K) = b0(C) − 1 + p − r(C),    b1 = b0 + b2 − b3 − χ,    components of the surface = b0(K) + b0(C) − 1 + p − r

by Alexander duality and the Mayer–Vietoris sequence, with rational coefficients. The box is counted with its first
layer once more after its last one, so that all neighbors are beside each other. These two layers are the same: a region
with a voxel in the last one is joined to that with the same voxel in the first one, one period further.

In a box cut out of a larger body voxels are points of a larger lattice. By its cubes alone (see `minkowski`), a cell
counts half if it lies in the first or last layer of an axis, a quarter in two of these, an eighth in three. So boxes
that share their end layers add up to the whole.

References:
    A. Odgaard, H. J. G. Gundersen, "Quantification of connectivity in cancellous bone, with special emphasis on 3-D
    reconstructions", Bone 14, 1993, doi:10.1016/8756-3282(93)90245-6 (Δχ and connectivity density).
    A. Hatcher, "Algebraic Topology", 2002, section 3.3 (duality).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from topokit.core.arrays import Booleans, Integers
from topokit.core.blocks.cube_parts import count_cube_part
from topokit.core.blocks.division import Box
from topokit.core.blocks.part import Part, Periodic, count_box
from topokit.core.grid.minkowski import euler_of


@dataclass(frozen=True)
class PeriodicSolid:
    """What is counted of a solid in a periodic box.

    Attributes:
        euler: χ of the solid.
        betti: (b0, b1, b2) of the solid: pieces, tunnels (loops around the box, too), cavities (sheets across it, too).
        n_surfaces: components of its surface.
        cubes: (256,) see `cube_counts`.
    """

    euler: int
    betti: tuple[int, int, int]
    n_surfaces: int
    cubes: Integers = field(repr=False, compare=False)

    @property
    def genus(self) -> int:
        """Handles of the surface, summed over its components; its χ is twice that of the solid."""
        return self.n_surfaces - self.euler


def count_periodic(inside: Booleans, connectivity: int, periodic: Periodic) -> PeriodicSolid:
    """Count a solid in a box that is periodic along some axes; along the others there is background beyond.

    Args:
        inside: (X, Y, Z), whether a voxel is in the solid.
        connectivity: 6 or 26, that of the solid.
        periodic: along which axes the last layer touches the first.
    """
    longer = np.pad(inside, [(0, int(wraps)) for wraps in periodic], mode="wrap")
    x, y, z = longer.shape
    box: Box = ((0, x), (0, y), (0, z))
    part = count_box(longer, box, longer.shape, connectivity, periodic)
    has_layer = [not wraps for wraps in periodic]
    return periodic_solid(part, count_cube_part(longer, box, longer.shape, has_layer).counts, connectivity, periodic)


def periodic_solid(part: Part, cubes: Integers, connectivity: int, periodic: Periodic) -> PeriodicSolid:
    """What the part of a whole periodic box says about it.

    Args:
        part: of the box with its first layer once more after the last one of periodic axes, and with one layer of
            background at both ends of the others.
        cubes: (256,) of the same; see `cube_counts`.
        connectivity: 6 or 26, that of the solid.
        periodic: along which axes the last layer touches the first.
    """
    pieces, winding = _components(part, connectivity == 6, periodic)
    regions, around = _components(part, connectivity == 26, periodic)
    euler = round(euler_of(cubes, connectivity))
    if regions == 0:
        return PeriodicSolid(0, (1, 3, 3), 0, cubes)
    cavities = regions - 1 + sum(periodic) - _rank(around)
    n_surfaces = pieces + regions - 1 + sum(periodic) - _rank(np.concatenate((winding, around))) if pieces else 0
    betti = (pieces, pieces + cavities - euler, cavities) if pieces else (0, 0, 0)
    return PeriodicSolid(euler, betti, n_surfaces, cubes)


def _components(part: Part, is_six: bool, periodic: Periodic) -> tuple[int, Integers]:
    """Components of a phase in a periodic box, and how loops in them wind around its axes: vectors (L, 3) span all."""
    root, n_components = list(range(len(part.nodes))), int((part.is_six == is_six).sum())
    offset = np.zeros((len(part.nodes), 3), np.int64)  # of a region from its root, in periods
    winding = [np.zeros(3, np.int64)]
    for one, other, shift in _joints(part, is_six, periodic):
        (first, before), (second, after) = _found(root, offset, one), _found(root, offset, other)
        around = before + shift - after
        if first != second:
            root[second], offset[second] = first, around
            n_components -= 1
        elif around.any():
            winding.append(around)
    return n_components, np.unique(winding, axis=0)


def _found(root: list[int], offset: Integers, node: int) -> tuple[int, Integers]:
    """The root of a region, and how many periods the region is away from it; the way there is shortened."""
    periods = np.zeros(3, np.int64)
    while root[node] != node:
        above = root[node]
        if root[above] != above:
            root[node], offset[node] = root[above], offset[node] + offset[above]
        periods += offset[node]
        node = root[node]
    return node, periods


def _joints(part: Part, is_six: bool, periodic: Periodic) -> Iterator[tuple[int, int, Integers]]:
    """Regions of a phase that hold the same voxel, the first one in the last layer of an axis, and the axis."""
    for axis in (axis for axis in range(3) if periodic[axis]):
        low, high = (labels.ravel() * (1 if is_six else -1) for labels in part.faces[axis])
        for one, other in np.unique(np.stack((high, low))[:, low > 0], axis=1).T.tolist():
            yield one - 1, other - 1, np.eye(3, dtype=np.int64)[axis]


def _rank(vectors: Integers) -> int:
    return int(np.linalg.matrix_rank(vectors))
