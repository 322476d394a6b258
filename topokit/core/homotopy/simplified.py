"""Solids without the parts, tunnels and cavities that are narrower than a width, by least change.

What closing the solid removes, and what closing its background removes, are two lists of patches. A feature that is
both thin and narrow is in both. The cheapest patches are applied first; one whose feature is gone would no longer
change the Euler characteristic as it should, and is left out. The result is counted as a whole. What was found is
looked at again with its surroundings, until no step is left.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.grid.euler import dual_connectivity, solid_euler
from topokit.core.homotopy.closing import Filled, Patch, Regions, Widths, closing, regions
from topokit.core.homotopy.layer import MARGIN, Box, layer_around
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


class _Counted(NamedTuple):
    """A solid's components, its Euler characteristic, and its numbers of parts, tunnels and cavities."""

    regions: Regions
    euler: int
    betti: Betti


class _Wanted(NamedTuple):
    """What `simplified` is asked for."""

    cost: Floats | None
    below: float
    ways: frozenset[Way]
    widths: Widths
    connectivity: int
    spacing: tuple[float, float, float]

    @property
    def reach(self) -> float:
        """Largest distance between the centers of a voxel that changes and of one on the other side."""
        return self.below / 2 + _HALF_DIAGONAL * max(self.spacing)


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
    solid = np.pad(inside, MARGIN)
    cost = None if cost is None else np.pad(cost, MARGIN)
    asked = _Wanted(cost, below, ways, widths, connectivity, spacing)
    beside = 2 * int(np.ceil(asked.reach / min(spacing)))
    counted = _counted(solid, _euler(solid, connectivity), connectivity)
    boxes: list[Box] = [(slice(None), slice(None), slice(None))]
    taken: list[Step] = []
    while boxes:
        found = [step for is_added in (False, True) for step in _steps(solid, counted, is_added, boxes, asked)]
        found.sort(key=lambda step: _cost(step, cost))
        done, counted = _taken(solid, found, counted, connectivity)
        taken += done
        boxes = [_box_around(step, beside, solid.shape) for step in found] if done else []
    inner = (slice(MARGIN, -MARGIN),) * 3
    return solid[inner].copy(), [_moved(step) for step in taken]


def _steps(solid: Booleans, counted: _Counted, is_added: bool, boxes: list[Box], asked: _Wanted) -> list[Step]:
    """The changes of one sign that remove features, within some boxes."""
    if not any(_WAYS[is_added, dimension] in asked.ways for dimension in range(3)):
        return []

    def wanted(dimension: int, sizes: Floats) -> Booleans:
        return (sizes < asked.below) & (_WAYS[is_added, dimension] in asked.ways)

    own, known = (solid, counted.regions) if is_added else (~solid, Regions(*counted.regions[::-1]))
    layer = layer_around(own, boxes, asked.reach, asked.spacing)
    connectivity = asked.connectivity if is_added else dual_connectivity(asked.connectivity)
    patches = closing(own, known, layer, lambda at: asked.widths(at - MARGIN), wanted, asked.cost, connectivity)
    return [_step(patch, is_added, solid.shape) for patch in patches]


def _step(patch: Patch, is_added: bool, shape: tuple[int, ...]) -> Step:
    return Step(np.stack(np.unravel_index(patch.voxels, shape), axis=1), is_added, patch.filled)


def _moved(step: Step) -> Step:
    """A step in the solid without the layers around it."""
    filled = tuple(one._replace(voxel=one.voxel - MARGIN) for one in step.filled)
    return Step(step.voxels - MARGIN, step.is_added, filled)


def _cost(step: Step, cost: Floats | None) -> float:
    return float(len(step.voxels) if cost is None else cost[tuple(step.voxels.T)].sum())


def _taken(solid: Booleans, steps: list[Step], before: _Counted, connectivity: int) -> tuple[list[Step], _Counted]:
    """Apply steps, in place, that have the effect they should have; if not all do together, then by halves.

    A step beside one that was applied is left for the next round, because what it would remove may have changed.
    """
    done: list[Step] = []
    is_changed = np.zeros(solid.shape, dtype=bool)
    expected, euler = np.array(before.betti), before.euler
    for step in steps:
        box, at = _box_around(step, 1, solid.shape), tuple(step.voxels.T)
        if is_changed[box].any():
            continue
        euler_before = _euler(solid[box], connectivity)
        solid[at] = step.is_added
        if _euler(solid[box], connectivity) - euler_before != step.euler:
            solid[at] = not step.is_added
            continue
        is_changed[at] = True
        done.append(step)
        euler += step.euler
        np.subtract.at(expected, [_ROW[kind] for kind, _ in step.ways], 1)
    if not done:
        return [], before
    after = _counted(solid, euler, connectivity)
    if after.betti == tuple(expected):
        return done, after
    solid[is_changed] ^= True
    if len(done) == 1:
        return [], before
    half = len(done) // 2
    first, middle = _taken(solid, done[:half], before, connectivity)
    second, last = _taken(solid, done[half:], middle, connectivity)
    return first + second, last


def _box_around(step: Step, margin: int, shape: tuple[int, ...]) -> Box:
    """The box of a step, so many voxels wider at each side where the volume goes on."""
    low, high = step.voxels.min(axis=0) - margin, step.voxels.max(axis=0) + margin + 1
    x, y, z = (slice(max(a, 0), min(b, n)) for a, b, n in zip(low.tolist(), high.tolist(), shape, strict=True))
    return x, y, z


def _euler(solid: Booleans, connectivity: int) -> int:
    return int(solid_euler(solid, connectivity=connectivity))


def _counted(solid: Booleans, euler: int, connectivity: int) -> _Counted:
    """A solid's components and numbers, given its Euler characteristic, which is known from the steps taken."""
    found = regions(solid, connectivity)
    pieces, cavities = int(found.parts.max()), int(found.holes.max()) - 1
    return _Counted(found, euler, (pieces, pieces + cavities - euler, cavities))
