"""All labels of a labeled volume, counted in one pass over its voxels.

Each label is a solid whose background is everything else, also the other labels. The pass finds cells, regions of equal
values that are joined through faces, and the walls between them. The rest is counted in the graph of cells: pieces of a
label are cells joined through edges and corners, and its background is the graph without them (see `without`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Integers
from topokit.core.blocks.cells import join_cells, junction_tables, number_cells, wall_cells
from topokit.core.blocks.part import NODE_COLUMNS, Labels, Part, summed_walls
from topokit.core.blocks.planes import gather_nodes, number_roots
from topokit.core.blocks.whole import CountedVolume, counted_volumes
from topokit.core.blocks.without import components_without
from topokit.core.grid.grid import Grid

_MOST_PAIRS = 64  # of cells that one cube may add: each of 28 once, and 4 walls of each of 8 labels
_PLACES = 1 << 14  # pairs of cells whose sums are kept at hand
_ROOM = 1 << 18  # pairs that are added up at once


def count_labels(values: NDArray[Any], labels: Integers, connectivity: int, grid: Grid) -> dict[int, CountedVolume]:
    """What is counted of each label of a volume, on the CPU.

    Args:
        values: (X, Y, Z) whole numbers.
        labels: (K,) those to count, ascending, each with a voxel; all other values are background.
        connectivity: 6 or 26, that of each label by itself.
        grid: where the centers of the voxels are.
    """
    cells: NDArray[Any] = np.zeros([n + 2 for n in values.shape], "i4" if values.size < 1 << 30 else "i8")
    nodes = _nodes(values, cells)
    owners = _owners(values, nodes, labels)
    walls, parents, duals = _walls(cells, owners, connectivity)
    numbers = np.empty(len(nodes), np.int32)
    pieces = np.empty((number_roots(parents, numbers), nodes.shape[1]), np.int64)
    gather_nodes(nodes, numbers, pieces)
    owner_of_piece, duals_of_labels = np.empty(len(pieces), np.int64), np.zeros(len(labels) + 1, np.int64)
    owner_of_piece[numbers] = owners
    np.add.at(duals_of_labels, owners, duals)  # the last one is that of the background

    # Walls as edges in both directions, by the label of their first cell.
    walls = np.concatenate((walls[:, :6], walls[:, [1, 0, 6, 7, 8, 9]]))
    owner_of_wall = owners[walls[:, 0]]
    order = np.argsort(owner_of_wall, kind="stable")
    walls, starts = walls[order], np.searchsorted(owner_of_wall[order], np.arange(len(labels) + 1))
    region, owner_of_region, regions = components_without(owners, walls[:, :2].copy(), starts, nodes)

    is_owned = owner_of_piece >= 0
    place = np.cumsum(is_owned) - 1
    walls[:, 0], walls[:, 1] = place[numbers[walls[:, 0]]], region + is_owned.sum()
    part = Part(
        np.concatenate((pieces[is_owned], regions)),
        np.repeat((connectivity == 6, connectivity == 26), (is_owned.sum(), len(regions))),
        summed_walls(walls[region >= 0]),
        int(duals_of_labels[:-1].sum()),
        (),
    )
    owners = np.concatenate((owner_of_piece[is_owned], owner_of_region))
    counted = counted_volumes(part, owners, duals_of_labels[:-1], connectivity, grid)
    return dict(zip(labels.tolist(), counted, strict=True))


def _nodes(values: NDArray[Any], cells: NDArray[Any]) -> Integers:
    """Write the number of its cell for every voxel, and return a row of `NODE_COLUMNS` for each cell."""
    size = max(4, values.dtype.itemsize)  # loops are compiled for two types
    same_size = values if values.dtype.itemsize == size else values.astype(f"u{size}")
    bits = np.ascontiguousarray(same_size).view(f"u{size}")
    nodes = np.zeros((join_cells(bits, cells) + 1, len(NODE_COLUMNS)), np.int64)
    number_cells(bits, cells, nodes)
    return nodes


def _owners(values: NDArray[Any], nodes: Integers, labels: Integers) -> Integers:
    """The number of the label of each cell; −1 for those without one, and for cell 0 around the volume."""
    first = np.stack(np.unravel_index(nodes[1:, 1], [n + 2 for n in values.shape])) - 1
    found = values[tuple(first)].astype(np.int64)
    numbers = np.minimum(np.searchsorted(labels, found), len(labels) - 1)
    return np.concatenate(([-1], np.where(labels[numbers] == found, numbers, -1)))


def _walls(cells: NDArray[Any], owners: Integers, connectivity: int) -> tuple[Integers, Labels, Integers]:
    """The walls between cells, as rows of sums; the forest of cells of one piece; and the sums of duals by cell."""
    parents, duals = np.arange(len(owners), dtype=np.int32), np.zeros(len(owners), np.int64)
    sums = np.full((_PLACES, 10), -1, np.int64)
    full = np.empty((max(_ROOM, 2 * _MOST_PAIRS * cells.shape[2]), 10), np.int64)
    walls, row, n_rows = [], 0, (cells.shape[0] - 1) * (cells.shape[1] - 1)
    while row < n_rows:
        row, n_full = wall_cells(
            cells, row, owners, connectivity == 6, parents, junction_tables(), duals, sums, full, _MOST_PAIRS
        )
        walls.append(summed_walls(full[:n_full].copy()))
    return summed_walls(np.concatenate((*walls, sums[sums[:, 0] >= 0]))), parents, duals
