"""Solids in boxes whose ends are no ends: joined to the opposite ones, or cut out of a larger body.

In a periodic box M, a torus along its periodic axes and unbounded along the others, the Betti numbers of a solid K with
complement C follow from components and from winding: how often a loop goes around each periodic axis. With p periodic
axes, winding ranks r(K), r(C) and r of both together, and b3 = 1 only if K is a whole 3-torus,

    b2(K) = b0(C) − 1 + p − r(C),    b1 = b0 + b2 − b3 − χ,    components of the surface = b0(K) + b0(C) − 1 + p − r

by Alexander duality and the Mayer–Vietoris sequence, with rational coefficients.

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
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from topokit.core.arrays import Booleans, Integers
from topokit.core.grid.euler import dual_connectivity
from topokit.core.grid.minkowski import cube_counts, euler_of

Periodic = tuple[bool, bool, bool]


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
    box = np.pad(inside, [(0 if wraps else 1,) * 2 for wraps in periodic])
    cubes = cube_counts(np.pad(box, [(0, int(wraps)) for wraps in periodic], mode="wrap"))
    euler = round(euler_of(cubes, connectivity))
    pieces, winding = _components(box, connectivity, periodic)
    regions, around = _components(~box, dual_connectivity(connectivity), periodic)
    if regions == 0:
        return PeriodicSolid(0, (1, 3, 3), 0, cubes)
    cavities = regions - 1 + sum(periodic) - _rank(around)
    n_surfaces = pieces + regions - 1 + sum(periodic) - _rank(np.concatenate((winding, around))) if pieces else 0
    betti = (pieces, pieces + cavities - euler, cavities) if pieces else (0, 0, 0)
    return PeriodicSolid(euler, betti, n_surfaces, cubes)


def _components(inside: Booleans, connectivity: int, periodic: Periodic) -> tuple[int, Integers]:
    """Components in a periodic box, and how loops in them wind around its axes: vectors (L, 3) that span all."""
    is_wide = connectivity == 26
    labels, n_labels = ndimage.label(inside, structure=np.ones((3, 3, 3)) if is_wide else None)
    root = list(range(n_labels + 1))
    offset = np.zeros((n_labels + 1, 3), np.int64)  # of a label from its root, in periods
    winding, n_components = [np.zeros(3, np.int64)], n_labels
    for one, other, shift in _joints(labels, is_wide, periodic):
        (first, before), (second, after) = _found(root, offset, one), _found(root, offset, other)
        around = before + shift - after
        if first != second:
            root[second], offset[second] = first, around
            n_components -= 1
        elif around.any():
            winding.append(around)
    return n_components, np.unique(winding, axis=0)


def _found(root: list[int], offset: Integers, label: int) -> tuple[int, Integers]:
    """The root of a label, and how many periods the label is away from it; the way there is shortened."""
    periods = np.zeros(3, np.int64)
    while root[label] != label:
        above = root[label]
        if root[above] != above:
            root[label], offset[label] = root[above], offset[label] + offset[above]
        periods += offset[label]
        label = root[label]
    return label, periods


def _joints(labels: NDArray[np.int32], is_wide: bool, periodic: Periodic) -> Iterator[tuple[int, int, Integers]]:
    """Labels that touch across the ends of periodic axes: two of them, and the periods from the first to the second."""
    for axis in (axis for axis in range(3) if periodic[axis]):
        last = np.take(labels, -1, axis)
        others = [other for other in range(3) if other != axis]
        for steps in product((-1, 0, 1), repeat=2) if is_wide else ((0, 0),):
            shift = np.zeros((2, *last.shape), np.int64)
            first, inside = np.take(labels, 0, axis), np.ones(last.shape, bool)
            for place, (other, step) in enumerate(zip(others, steps, strict=True)):
                n = labels.shape[other]
                index = np.arange(n) + step
                first = np.take(first, index % n, place)
                beyond = np.expand_dims(index // n, 1 - place)
                shift[place] += beyond
                inside &= periodic[other] | (beyond == 0)
            pairs = np.stack((last, first, *shift))[:, inside & (last > 0) & (first > 0)]
            for one, other, a, b in np.unique(pairs, axis=1).T.tolist():
                periods = np.zeros(3, np.int64)
                periods[[axis, *others]] = 1, a, b
                yield one, other, periods


def _rank(vectors: Integers) -> int:
    return int(np.linalg.matrix_rank(vectors))
