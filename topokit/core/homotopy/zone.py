"""The part of a volume in which voxels may change sides, and what is connected through the rest of it.

The regions of both phases outside the zone are labeled once. After that, regions of the whole volume follow from the
zone's own voxels by union-find, so their cost is that of the zone.
"""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Booleans, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.blocks.planes import root_of, unite
from topokit.core.homotopy.growth import Nodes, first_bit, strides_around
from topokit.core.homotopy.runs import labeled
from topokit.core.homotopy.simple_points import OFFSETS, Counts, Indices, code_at, component, exchanged, touching

Ends = tuple[tuple[bool, bool], tuple[bool, bool], tuple[bool, bool]]
"""For each axis, whether the volume goes on before the first layer of a block, and after the last one."""

CLOSED: Ends = ((False, False), (False, False), (False, False))


class Zone:
    """Voxels of a volume, of which any may be in the solid.

    Attributes:
        voxels: (N,) their flat indices, ascending.
        nodes: (M,) of all voxels, a number of its own for each voxel of the zone, and one for each region outside of
            it.
        n_outside: number of regions outside.
        n_nodes: numbers from 0 on that there are in all.
        around: (27,) steps to the neighbors of a voxel.
    """

    def __init__(self, solid: Booleans, voxels: Integers, connectivity: int, ends: Ends = CLOSED) -> None:
        """Take a solid.

        Args:
            solid: (X, Y, Z).
            voxels: (N,) of the zone, ascending flat indices, none of them in an end layer.
            connectivity: 6 or 26, that of the solid.
            ends: at which of its ends the volume goes on.
        """
        self.voxels, self.around = voxels, strides_around(solid.shape)
        self.nodes, self._states = labeled(solid, voxels, connectivity)
        self.n_outside = len(self._states) - 1
        self._open = _at_ends(self.nodes, solid.shape, ends)
        self.nodes[voxels] = np.arange(len(voxels)) + len(self._states)
        self.n_nodes = self.n_outside + len(voxels) + 1
        self._clusters = np.arange(self.n_nodes, dtype=np.int32)
        _cluster(voxels, self.nodes, self.n_outside, self.around, self._clusters)

    def forest(self, inside: Counts, phase: int, connectivity: int) -> Nodes:
        """A forest of the nodes (K,) in which those of one region of a phase have one root.

        Args:
            inside: (M,) 1 inside.
            phase: 1 for the solid, 0 for the background.
            connectivity: 6 or 26, that of the phase.
        """
        parents = np.arange(self.n_nodes, dtype=np.int32)
        _unite(inside, phase, self.voxels, self.nodes, self.n_outside, *self._steps(connectivity), parents)
        return parents

    def with_outside(self, parents: Nodes, inside: Counts, phase: int) -> Nodes:
        """The forest of a phase if all its regions that reach where the volume goes on are joined there."""
        at_ends = self.nodes[self._open[inside[self._open] == phase]]
        if len(at_ends) < 2:
            return parents
        joined = parents.copy()
        for node in at_ends[1:]:
            unite(joined, int(at_ends[0]), int(node))
        return joined

    def join(self, parents: Nodes, inside: Counts, phase: int, voxels: Indices, connectivity: int) -> None:
        """Add some voxels (N,) of a phase to its forest."""
        _unite(inside, phase, voxels, self.nodes, self.n_nodes, *self._steps(connectivity), parents)

    def _steps(self, connectivity: int) -> tuple[Integers, int]:
        """Steps to the voxels around one that it is joined to.

        Returns:
            (N,), and the number of the first ones that lead to voxels to which the voxel before is joined, too.
        """
        if connectivity == 6:
            return self.around[np.abs(OFFSETS).sum(axis=1) == 1], 0
        is_shared = (OFFSETS[:, 2] < 1) & OFFSETS[:, :2].any(axis=1)
        is_own = ~is_shared & OFFSETS.any(axis=1)
        return np.concatenate((self.around[is_shared], self.around[is_own])), int(is_shared.sum())

    @property
    def is_open(self) -> bool:
        """Whether any region reaches where the volume goes on."""
        return len(self._open) > 0

    def part_of(self, voxels: Indices) -> Nodes:
        """A number (N,) for the part of the zone that each of some voxels is in; parts do not touch by corners."""
        parts: Nodes = self._clusters[self.nodes[voxels]]
        return parts

    def are_with(self, voxels: Indices, others: Indices) -> Booleans:
        """Which voxels (N,) of the zone are in one part of it, joined also by corners, with one of others (M,)."""
        has_other = np.zeros(len(self._clusters), dtype=bool)
        has_other[self.part_of(others)] = True
        return has_other[self.part_of(voxels)]

    def counts(self, inside: Counts, solid: Nodes, background: Nodes) -> tuple[int, int]:
        """Numbers of regions of the solid and of the background, given their forests."""
        states, own = np.concatenate((self._states, inside[self.voxels])), np.arange(len(solid))
        return int(((solid == own) & (states == 1)).sum()), int(((background == own) & (states == 0)).sum())


def _at_ends(nodes: Nodes, shape: tuple[int, ...], ends: Ends) -> Integers:
    """A voxel (K,) of each region that is in those end layers of a block where the volume goes on."""
    found = np.empty(0, dtype=np.int64)
    for axis, both in enumerate(ends):
        for place, goes_on in zip((0, shape[axis] - 1), both, strict=True):
            if goes_on:
                sides = [np.arange(n) if k != axis else np.array([place]) for k, n in enumerate(shape)]
                found = np.concatenate((found, np.ravel_multi_index(np.ix_(*sides), shape).ravel()))
                found = found[np.unique(nodes[found], return_index=True)[1]]
    return found


@compiled
def _unite(
    inside: Counts,
    phase: int,
    voxels: Indices,
    nodes: Nodes,
    n_outside: int,
    steps: Integers,
    n_shared: int,
    parents: Nodes,
) -> None:
    """Join voxels of a phase with those some steps away; of two nodes above `n_outside` the later one does it.

    The first steps are left out if the voxel before has just been joined to the same voxels.
    """
    last = -1
    for voxel in voxels:
        if inside[voxel] != phase:
            continue
        root = root_of(parents, nodes[voxel])
        first, last = n_shared if last == voxel - 1 else 0, voxel
        for k in range(first, len(steps)):
            other = voxel + steps[k]
            if inside[other] != phase or (steps[k] > 0 and nodes[other] > n_outside):
                continue
            if parents[nodes[other]] == root:
                continue
            found = root_of(parents, nodes[other])
            if found != root:
                parents[found] = root


@compiled
def _cluster(voxels: Indices, nodes: Nodes, n_outside: int, around: Integers, parents: Nodes) -> None:
    """Write the root of the part of a zone that each of its voxels is in."""
    last = -1
    for voxel in voxels:
        root = root_of(parents, nodes[voxel])
        is_next, last = last == voxel - 1, voxel
        for k in range(13):
            if is_next and k % 3 != 2 and k != 12:
                continue  # the voxel before is joined to it
            other = nodes[voxel + around[k]]
            if other > n_outside:
                found = root_of(parents, other)
                if found != root:
                    parents[found] = root
    for voxel in voxels:
        parents[nodes[voxel]] = root_of(parents, nodes[voxel])


@compiled
def joins(
    inside: Counts, phase: int, nodes: Nodes, parents: Nodes, voxels: Indices, around: Integers, connectivity: int
) -> Counts:
    """Add voxels to a phase one after the other if each only joins regions that were apart: Kruskal's algorithm.

    Args:
        inside: (M,) 1 inside; changed in place.
        phase: 1 for the solid, 0 for the background.
        nodes: (M,) of the voxels.
        parents: forest of the regions of the phase; changed in place.
        voxels: (N,) flat indices in the other phase, in the order in which they are tried.
        around: (27,) steps to the neighbors of a voxel.
        connectivity: 6 or 26, that of the phase.

    Returns:
        (N,) how many regions each voxel joined, −1 where it would have closed a loop and was not added.
    """
    n_joined = np.full(len(voxels), -1, dtype=np.int8)
    for row in range(len(voxels)):
        voxel = voxels[row]
        code = code_at(inside, voxel, around)
        if phase == 0:
            code = exchanged(code)
        left, own, is_loop = touching(code, connectivity), nodes[voxel], False
        roots = [0 for _ in range(0)]
        while left:
            bit = first_bit(left)
            root = int(root_of(parents, nodes[voxel + around[bit]]))
            is_loop |= root in roots
            roots.append(root)
            left &= ~component(code, 1 << bit, connectivity)
        if not is_loop:
            for root in roots:
                parents[root] = own
            inside[voxel], n_joined[row] = phase, len(roots)
    return n_joined
