"""Regions of voxels in equal states, labeled by runs along rows: a row of equal voxels costs as much as one voxel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Booleans, Integers
from topokit.core.blocks.compiled import compiled
from topokit.core.blocks.planes import number_roots, root_of
from topokit.core.homotopy.bits import are_set, changes, of_voxels, packed, voxels_of
from topokit.core.homotopy.growth import Nodes

States = NDArray[np.uint8]

ELSEWHERE = 2
"""The state of voxels that are in no region, beside 1 in the solid and 0 outside."""


def labeled(solid: Booleans, left_out: Integers, connectivity: int) -> tuple[Nodes, States]:
    """The regions of a solid and of its background without some voxels.

    Args:
        solid: (X, Y, Z).
        left_out: (N,) flat indices of the voxels that are in no region.
        connectivity: 6 or 26, that of the solid; the background has the other one.

    Returns:
        (X Y Z,) numbers from 1 on, meaningless where left out, and the states (K,) of what has each number from 0 on.
    """
    shape, length = solid.shape, solid.shape[2]
    is_elsewhere = of_voxels(left_out, shape)
    starts = voxels_of(changes(packed(solid), length) | changes(is_elsewhere, length), length)
    rows = np.searchsorted(starts, np.arange(0, solid.size + 1, length))
    ends = np.append(starts[1:], solid.size)
    states = solid.reshape(-1)[starts].view(np.uint8)
    states[are_set(is_elsewhere, starts, length)] = ELSEWHERE
    parents, numbers = np.arange(len(starts), dtype=np.int32), np.empty(len(starts), dtype=np.int32)
    _join_rows(starts, ends, states, rows, shape, connectivity, parents)
    n_regions = number_roots(parents, numbers)
    own = np.full(n_regions + 1, ELSEWHERE, dtype=np.uint8)
    own[numbers + 1] = states
    nodes = np.empty(solid.size, dtype=np.int32)
    _write_runs(starts, ends, numbers, nodes)
    return nodes, own


@compiled
def _write_runs(starts: Integers, ends: Integers, numbers: Nodes, nodes: Nodes) -> None:
    """Give every voxel the number of its run, from 1 on."""
    for run in range(len(starts)):
        number = numbers[run] + 1
        for at in range(starts[run], ends[run]):
            nodes[at] = number


@compiled
def _join_rows(
    starts: Integers,
    ends: Integers,
    states: States,
    rows: Integers,
    shape: tuple[int, int, int],
    connectivity: int,
    parents: Nodes,
) -> None:
    """Join runs that touch; each has its start and its end (last + 1) as flat indices, each row its first run."""
    for row in range(len(rows) - 1):
        x, y = row // shape[1], row % shape[1]
        for dx, dy in ((0, -1), (-1, 0), (-1, -1), (-1, 1)):
            if x + dx < 0 or not 0 <= y + dy < shape[1]:
                continue
            before = row + dx * shape[1] + dy
            shift, other = (row - before) * shape[2], rows[before]
            for own in range(rows[row], rows[row + 1]):
                if states[own] == ELSEWHERE:
                    continue
                joins_corners = (connectivity == 26) == (states[own] == 1)
                if not joins_corners and dx * dy != 0:
                    continue
                first, last = starts[own] - shift - joins_corners, ends[own] - shift + joins_corners
                while other < rows[before + 1] - 1 and ends[other] <= starts[own] - shift - 1:
                    other += 1
                k = other
                while k < rows[before + 1] and starts[k] < last:
                    if states[k] == states[own] and ends[k] > first:
                        one, two = root_of(parents, own), root_of(parents, k)
                        parents[max(one, two)] = min(one, two)
                    k += 1
