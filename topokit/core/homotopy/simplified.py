"""Solids without the parts, tunnels and cavities that are narrower than a width, by least change.

What closing the solid removes, and what closing its background removes, are two lists of patches. A feature that is
both thin and narrow is in both. The cheapest patches are applied first; one whose feature is gone would no longer
change the Euler characteristic as it should, and is left out. The result is counted as a whole. What was found is
looked at again with its surroundings, until no step is left. All this is done near narrow places only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.grid.euler import dual_connectivity, solid_euler
from topokit.core.homotopy.closing import Filled, Forests, Growth, Patch, Widths, closing
from topokit.core.homotopy.effects import flip
from topokit.core.homotopy.growth import Ranks
from topokit.core.homotopy.layer import layer_around
from topokit.core.homotopy.narrow import around_narrow_places, margins
from topokit.core.homotopy.simple_points import Counts
from topokit.core.homotopy.zone import CLOSED, Ends, Zone
from topokit.core.removal import KINDS, How, Kind

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


class Block(NamedTuple):
    """A block of a larger volume, in which only what is settled by the block alone is changed.

    Attributes:
        ends: at which of its ends the volume goes on.
        core: first and last + 1 voxel along each axis of the box in which narrow places are this block's to change; as
            far from where the volume goes on as `margins` says, or farther.
    """

    ends: Ends
    core: tuple[tuple[int, int], tuple[int, int], tuple[int, int]]

    def has(self, found: tuple[Filled, ...]) -> bool:
        """Whether all places are in the core."""
        sides = np.array(self.core)
        return all(((one.voxel >= sides[:, 0]) & (one.voxel < sides[:, 1])).all() for one in found)


class Simplified(NamedTuple):
    """What `simplified` found.

    Attributes:
        steps: each of which was counted.
        changed: (N, 3), the voxels that are on another side after them, each once.
        before: Betti numbers of the solid before.
        narrowest: lower bound of the widths of features that were seen and are not narrower; infinite if none was.
        unsettled: of a block, narrow places in its core which may or may not be features, depending on what is beyond
            the block, and what they would be.
    """

    steps: list[Step]
    changed: Integers
    before: Betti
    narrowest: float
    unsettled: list[tuple[Way, Filled]]


class _Counted(NamedTuple):
    """Forests of a solid and of its background, its Euler characteristic, and its numbers of features."""

    regions: Forests
    euler: int
    betti: Betti


class _Volume(NamedTuple):
    """A solid that changes, flat, with layers around it that do not.

    Attributes:
        solid: (M,) 1 inside.
        background: (M,) 1 outside.
        shape: (X, Y, Z) of both.
        first: layers along each axis before what may change.
        zone: where voxels may change sides.
        ranks: memory to work in; see `Growth`.
    """

    solid: Counts
    background: Counts
    shape: tuple[int, ...]
    first: tuple[int, int, int]
    zone: Zone
    ranks: Ranks

    def flip(self, at: Integers, connectivity: int) -> int:
        """Flip voxels, and return by how much the Euler characteristic of the solid changes."""
        self.background[at] ^= 1
        return flip(self.solid, at, self.zone.around, connectivity)


class _Wanted(NamedTuple):
    """What `simplified` is asked for, and the widths of features that are seen and not narrower."""

    cost: Floats | None
    below: float
    ways: frozenset[Way]
    connectivity: int
    spacing: tuple[float, float, float]
    wider: list[float]

    @property
    def reach(self) -> float:
        """Largest distance between the centers of a voxel that changes and of one on the other side."""
        return self.below / 2 + _HALF_DIAGONAL * max(self.spacing)


def simplified(
    inside: Booleans,
    cost: Floats | None,
    below: float,
    ways: frozenset[Way],
    widths: Callable[[Integers], Widths],
    connectivity: int,
    spacing: tuple[float, float, float],
    block: Block | None = None,
) -> Simplified:
    """A solid without the features narrower than a width, as far as ways to remove them are allowed.

    Args:
        inside: (X, Y, Z), the solid.
        cost: (X, Y, Z), positive, what it costs to change each voxel; None if all cost the same.
        below: width, in units of the spacing.
        ways: how features may be removed.
        widths: of places (M, 3), given the voxels (N, 3) that have changed sides.
        connectivity: 6 or 26, that of the solid.
        spacing: size of a voxel along each axis.
        block: what part of a larger volume this is; None if it is the whole.
    """
    asked = _Wanted(None, below, ways, connectivity, spacing, [np.inf])
    ends = CLOSED if block is None else block.ends
    sides = [(n * (not a), n * (not b)) for n, (a, b) in zip(margins(asked.reach, spacing), ends, strict=True)]
    if cost is not None:
        asked = asked._replace(cost=np.pad(cost, sides).ravel())
    x, y, z = (n for n, _ in sides)
    volume = _volume(np.ascontiguousarray(np.pad(inside, sides)), (x, y, z), asked, ends)
    counted = _counted(volume, int(solid_euler(inside, connectivity=connectivity)), connectivity)
    beside = 2 * int(np.ceil(asked.reach / min(spacing)))
    cells, taken, before = volume.zone.voxels, list[Step](), counted.betti
    unsettled: list[tuple[Way, Filled]] | None = None
    while len(cells):
        current = widths(_changed_voxels(taken) - volume.first)
        both = [_steps(volume, counted, is_added, cells, asked, current) for is_added in (False, True)]
        found = [step for steps, _ in both for step in steps]
        if block is not None:
            found = [step for step in found if block.has(_moved(step, volume.first).filled)]
        if unsettled is None:
            unsettled = [one for _, others in both for one in others]
        found.sort(key=lambda step: _cost(step, volume, asked.cost))
        done, counted = _taken(volume, found, counted, connectivity)
        taken += done
        cells = _near(volume, [step.voxels for step in found] if done else [], beside)
    rest = [(way, one._replace(voxel=one.voxel - volume.first)) for way, one in unsettled or []]
    rest = [(way, one) for way, one in rest if block is None or block.has((one,))]
    steps = [_moved(step, volume.first) for step in taken]
    return Simplified(steps, _changed_voxels(steps), before, min(asked.wider), rest)


def _volume(solid: Booleans, first: tuple[int, int, int], asked: _Wanted, ends: Ends) -> _Volume:
    """A solid with a zone around its narrow places, whether they are in the background or in the solid itself."""
    connectivity = asked.connectivity
    zone = Zone(solid, around_narrow_places(solid, asked.reach, asked.spacing, connectivity), connectivity, ends)
    ranks = np.full(zone.n_nodes, -1, dtype=np.int32)
    own, other = (one.ravel().view(np.int8) for one in (solid, ~solid))
    return _Volume(own, other, solid.shape, first, zone, ranks)


def _changed_voxels(steps: list[Step]) -> Integers:
    """The voxels (N, 3) that are on another side after some steps; one of two steps is on the side where it was."""
    voxels = np.concatenate([np.empty((0, 3), dtype=np.int64), *(step.voxels for step in steps)])
    once, counts = np.unique(voxels, axis=0, return_counts=True)
    return once[counts % 2 == 1]


def _steps(
    volume: _Volume, counted: _Counted, is_added: bool, cells: Integers, asked: _Wanted, widths: Widths
) -> tuple[list[Step], list[tuple[Way, Filled]]]:
    """The changes of one sign that remove features, within some voxels of the zone, and what is not settled."""
    if not any(_WAYS[is_added, dimension] in asked.ways for dimension in range(3)):
        return [], []

    def wanted(dimension: int, sizes: Floats) -> Booleans:
        asked.wider.append(float(sizes[sizes >= asked.below].min(initial=np.inf)))
        return (sizes < asked.below) & (_WAYS[is_added, dimension] in asked.ways)

    own = volume.solid if is_added else volume.background
    zone, ranks = volume.zone, volume.ranks
    layer = layer_around(own, cells[own[cells] == 0], zone, ranks, asked.reach, asked.spacing)
    connectivity = asked.connectivity if is_added else dual_connectivity(asked.connectivity)
    growth = Growth(own, volume.shape, zone, ranks, connectivity)
    parts, holes = counted.regions if is_added else counted.regions[::-1]
    known = zone.with_outside(parts, own, 1), holes
    patches, others = closing(growth, known, layer, lambda at: widths(at - volume.first), wanted, asked.cost)
    steps = [_step(patch, is_added, volume.shape) for patch in patches]
    return steps, [(_WAYS[is_added, one.dimension], one) for one in others]


def _step(patch: Patch, is_added: bool, shape: tuple[int, ...]) -> Step:
    return Step(np.stack(np.unravel_index(patch.voxels, shape), axis=1), is_added, patch.filled)


def _moved(step: Step, first: tuple[int, int, int]) -> Step:
    """A step in the solid without the layers around it."""
    filled = tuple(one._replace(voxel=one.voxel - first) for one in step.filled)
    return Step(step.voxels - first, step.is_added, filled)


def _at(step: Step, volume: _Volume) -> Integers:
    """The flat indices of a step's voxels."""
    return np.ravel_multi_index(tuple(step.voxels.T), volume.shape)


def _cost(step: Step, volume: _Volume, cost: Floats | None) -> float:
    return float(len(step.voxels) if cost is None else cost[_at(step, volume)].sum())


def _taken(volume: _Volume, steps: list[Step], before: _Counted, connectivity: int) -> tuple[list[Step], _Counted]:
    """Apply steps, in place, that have the effect they should have; if not all do together, then by halves.

    A step beside one that was applied is left for the next round, because what it would remove may have changed.
    """
    done: list[Step] = []
    is_changed = np.zeros(volume.shape, dtype=bool)
    expected, euler = np.array(before.betti), before.euler
    for step in steps:
        if is_changed[_box_around(step.voxels, 1, volume.shape)].any():
            continue
        if volume.flip(_at(step, volume), connectivity) != step.euler:
            volume.flip(_at(step, volume), connectivity)
            continue
        is_changed[tuple(step.voxels.T)] = True
        done.append(step)
        euler += step.euler
        np.subtract.at(expected, [KINDS.index(kind) for kind, _ in step.ways], 1)
    if not done:
        return [], before
    after = _counted(volume, euler, connectivity)
    if after.betti == tuple(expected):
        return done, after
    for step in done:
        volume.flip(_at(step, volume), connectivity)
    if len(done) == 1:
        return [], before
    half = len(done) // 2
    first, middle = _taken(volume, done[:half], before, connectivity)
    second, last = _taken(volume, done[half:], middle, connectivity)
    return first + second, last


def _near(volume: _Volume, places: list[Integers], margin: int) -> Integers:
    """The voxels of the zone that are in the boxes of some voxels (N, 3), so many voxels wider at each side."""
    is_near = np.zeros(volume.shape, dtype=bool)
    for voxels in places:
        is_near[_box_around(voxels, margin, volume.shape)] = True
    return volume.zone.voxels[is_near.ravel()[volume.zone.voxels]]


def _box_around(voxels: Integers, margin: int, shape: tuple[int, ...]) -> tuple[slice, ...]:
    """The box of some voxels (N, 3), so many voxels wider at each side where the volume goes on."""
    low, high = voxels.min(axis=0) - margin, voxels.max(axis=0) + margin + 1
    return tuple(slice(max(a, 0), min(b, n)) for a, b, n in zip(low.tolist(), high.tolist(), shape, strict=True))


def _counted(volume: _Volume, euler: int, connectivity: int) -> _Counted:
    """A solid's regions and numbers, given its Euler characteristic, which is known from the steps taken."""
    zone, dual = volume.zone, dual_connectivity(connectivity)
    found = zone.forest(volume.solid, 1, connectivity), zone.forest(volume.solid, 0, dual)
    pieces, outside = zone.counts(volume.solid, *found)
    return _Counted(found, euler, (pieces, pieces + outside - 1 - euler, outside - 1))
