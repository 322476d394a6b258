"""Solids without the parts, tunnels and cavities that are narrower than a width, by least change.

What closing the solid removes, and what closing its background removes, are two lists of patches. A feature that is
both thin and narrow is in both. The cheapest patches are applied first; one whose feature is gone would no longer
change the Euler characteristic as it should, and is left out. The result is counted as a whole.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.grid.betti import betti_numbers
from topokit.core.grid.euler import dual_connectivity, solid_euler
from topokit.core.homotopy.closing import Filled, Patch, Widths, closing
from topokit.core.removal import How, Kind

Way = tuple[Kind, How]
Betti = tuple[int, int, int]

_WAYS: Mapping[tuple[bool, int], Way] = {  # by whether voxels are added, and by the dimension that closing them ends
    (True, 0): ("part", "joined"),
    (True, 1): ("tunnel", "filled"),
    (True, 2): ("cavity", "filled"),
    (False, 0): ("cavity", "opened"),
    (False, 1): ("tunnel", "cut"),
    (False, 2): ("part", "dropped"),
}
_SIGNS: Mapping[Kind, int] = {"part": -1, "tunnel": 1, "cavity": -1}  # of the change of the solid's χ
_ROW: Mapping[Kind, int] = {"part": 0, "tunnel": 1, "cavity": 2}
_HALF_DIAGONAL = 0.87  # of a voxel: by so much distances between centers exceed those to the surface


class Step(NamedTuple):
    """A change of some voxels.

    Attributes:
        voxels: (N, 3) indices.
        is_added: whether they join the solid or leave it.
        filled: the classes that end, of the solid, or of the background if voxels leave.
    """

    voxels: Integers
    is_added: bool
    filled: tuple[Filled, ...]

    @property
    def ways(self) -> list[Way]:
        """What is removed, and how."""
        return [_WAYS[self.is_added, one.dimension] for one in self.filled]

    @property
    def euler(self) -> int:
        """By how much the Euler characteristic of the solid changes."""
        return sum(_SIGNS[kind] for kind, _ in self.ways)


def simplified(
    inside: Booleans,
    cost: Floats | None,
    below: float,
    ways: frozenset[Way],
    widths: Widths,
    connectivity: int,
    spacing: tuple[float, float, float],
) -> tuple[Booleans, list[Step]]:
    """A solid without the features narrower than a width, as far as ways to remove them are allowed.

    Args:
        inside: (X, Y, Z), the solid.
        cost: (X, Y, Z), positive, what it costs to change each voxel; None if all cost the same.
        below: width, in units of the spacing.
        ways: how features may be removed.
        widths: of the places at some voxels (M, 3).
        connectivity: 6 or 26, that of the solid.
        spacing: size of a voxel along each axis.

    Returns:
        (X, Y, Z) and the steps that lead to it, each of which was counted.
    """
    solid = np.pad(inside, 1)
    cost = None if cost is None else np.pad(cost, 1)
    taken: list[Step] = []
    while True:
        found = [
            step
            for is_added in (False, True)
            for step in _steps(solid, is_added, cost, below, ways, widths, connectivity, spacing)
        ]
        found.sort(key=lambda step: _cost(step, cost))
        before = _betti(solid, connectivity)
        done = _taken(solid, found, before, connectivity)
        if not done:
            return solid[1:-1, 1:-1, 1:-1].copy(), taken
        taken += done


def _cost(step: Step, cost: Floats | None) -> float:
    return float(len(step.voxels) if cost is None else cost[tuple(step.voxels.T + 1)].sum())


def _steps(
    solid: Booleans,
    is_added: bool,
    cost: Floats | None,
    below: float,
    ways: frozenset[Way],
    widths: Widths,
    connectivity: int,
    spacing: tuple[float, float, float],
) -> list[Step]:
    """The changes of one sign that remove features."""
    if not any(_WAYS[is_added, dimension] in ways for dimension in range(3)):
        return []

    def wanted(dimension: int, sizes: Floats) -> Booleans:
        return (sizes < below) & (_WAYS[is_added, dimension] in ways)

    own = solid if is_added else ~solid
    distance = distance_transform_edt(~own, spacing)
    reach = below / 2 + _HALF_DIAGONAL * max(spacing)
    own_connectivity = connectivity if is_added else dual_connectivity(connectivity)
    patches = closing(own, distance, reach, lambda at: widths(at - 1), wanted, cost, own_connectivity)
    return [_step(patch, is_added, solid.shape) for patch in patches]


def _step(patch: Patch, is_added: bool, shape: tuple[int, ...]) -> Step:
    filled = tuple(one._replace(voxel=one.voxel - 1) for one in patch.filled)
    return Step(np.stack(np.unravel_index(patch.voxels, shape), axis=1) - 1, is_added, filled)


def _taken(solid: Booleans, steps: list[Step], before: Betti, connectivity: int) -> list[Step]:
    """Apply steps, in place, that have the effect they should have; if not all do together, then by halves.

    A step beside one that was applied is left for the next round, because what it would remove may have changed.
    """
    done: list[Step] = []
    original = solid.copy()
    expected = np.array(before)
    for step in steps:
        box, at = _box_around(step)
        part = solid[box].copy()
        part[at] = step.is_added
        change = _euler(part, connectivity) - _euler(solid[box], connectivity)
        if change == step.euler and np.array_equal(solid[box], original[box]):
            solid[box] = part
            done.append(step)
            np.subtract.at(expected, [_ROW[kind] for kind, _ in step.ways], 1)
    if not done or _betti(solid, connectivity) == tuple(expected):
        return done
    solid[:] = original
    if len(done) == 1:
        return []
    half = len(done) // 2
    first = _taken(solid, done[:half], before, connectivity)
    return first + _taken(solid, done[half:], _betti(solid, connectivity), connectivity)


def _box_around(step: Step) -> tuple[tuple[slice, ...], tuple[Integers, ...]]:
    """The box of the padded solid one voxel wider than a step, and where its voxels are in that box."""
    low, high = step.voxels.min(axis=0), step.voxels.max(axis=0) + 3
    return tuple(slice(a, b) for a, b in zip(low, high, strict=True)), tuple((step.voxels + 1 - low).T)


def _euler(solid: Booleans, connectivity: int) -> int:
    return int(solid_euler(solid, connectivity=connectivity))


def _betti(solid: Booleans, connectivity: int) -> Betti:
    b0, b1, b2 = betti_numbers(solid, connectivity=connectivity).tolist()
    return b0, b1, b2
