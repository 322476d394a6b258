"""All labels of a labeled volume, counted in one pass over its voxels.

Each label is a solid whose background is everything else, also the other labels. The pass finds cells, regions of equal
values that are joined through faces, and the walls between them. The rest is counted in the graph of cells: pieces of a
label are cells joined through edges and corners, and its background is the graph without them (see `without`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.core.arrays import Integers
from topokit.core.blocks.cells import describe_cells, junction_tables, number_cells, wall_cells
from topokit.core.blocks.part import NODE_COLUMNS, PLACES, Labels, Part, summed_walls
from topokit.core.blocks.planes import gather_nodes, number_roots
from topokit.core.blocks.whole import CountedVolume, counted_volume
from topokit.core.blocks.without import components_without
from topokit.core.grid.grid import Grid

_MOST_PAIRS = 64  # of cells that one cube may add: each of 28 once, and 4 walls of each of 8 labels
_ROOM = 1 << 18  # pairs that are added up at once


@dataclass(frozen=True, eq=False)
class CountedLabels:
    """What is counted of each label.

    Attributes:
        labels: (K,) ascending.
        part: of all labels together: first the pieces by label, then the regions of their backgrounds; walls by label.
        pieces: (K + 1,) where the pieces of each label start in the nodes of the part.
        regions: (K + 1,) likewise the regions of its background.
        walls: (K + 1,) likewise its walls.
        duals: (K,) `Part.dual` of each.
        connectivity: 6 or 26, that of the labels.
        grid: of the volume.
    """

    labels: Integers
    part: Part
    pieces: Integers
    regions: Integers
    walls: Integers
    duals: Integers
    connectivity: int
    grid: Grid

    def of(self, label: int) -> CountedVolume:
        """What is counted of a label."""
        number = int(np.searchsorted(self.labels, label))
        pieces, regions, walls = (
            slice(*starts[number : number + 2]) for starts in (self.pieces, self.regions, self.walls)
        )
        nodes = np.concatenate((self.part.nodes[pieces], self.part.nodes[regions]))
        is_six = np.concatenate((self.part.is_six[pieces], self.part.is_six[regions]))
        own = self.part.walls[walls].copy()
        own[:, 0] -= pieces.start
        own[:, 1] += pieces.stop - pieces.start - regions.start
        return counted_volume(Part(nodes, is_six, own, int(self.duals[number]), ()), self.connectivity, self.grid)


def count_labels(values: NDArray[Any], labels: Integers, connectivity: int, grid: Grid) -> CountedLabels:
    """What is counted of each label of a volume, on the CPU.

    Args:
        values: (X, Y, Z) whole numbers.
        labels: (K,) those to count, ascending, each with a voxel; all other values are background.
        connectivity: 6 or 26, that of each label by itself.
        grid: where the centers of the voxels are.
    """
    cells: NDArray[Any] = np.zeros([n + 2 for n in values.shape], "i4" if values.size < 1 << 30 else "i8")
    bits = np.ascontiguousarray(values, dtype="u4" if values.dtype.itemsize <= 4 else "u8")  # compiled for two types
    nodes = np.zeros((number_cells(bits, cells) + 1, len(NODE_COLUMNS)), np.int64)
    describe_cells(cells, nodes)
    owners = _owners(values, nodes, labels)
    walls, parents, duals = _walls(cells, owners, len(labels), connectivity)
    numbers = np.empty(len(nodes), np.int32)
    pieces = np.empty((number_roots(parents, numbers), nodes.shape[1]), np.int64)
    gather_nodes(nodes, numbers, pieces)
    owner_of_piece = np.empty(len(pieces), np.int64)
    owner_of_piece[numbers] = owners

    # Walls as edges in both directions, by the label of their first cell.
    walls = summed_walls(np.concatenate((walls, walls[:, [1, 0, 2, 2, 2, 2]] * (1, 1, 0, 0, 0, 0))))
    walls = walls[np.argsort(owners[walls[:, 0]], kind="stable")]
    starts = np.searchsorted(owners[walls[:, 0]], np.arange(len(labels) + 1))
    region, owner_of_region, regions = components_without(owners, walls[:, :2].copy(), starts, nodes)

    order = np.argsort(owner_of_piece, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order)) - (owner_of_piece < 0).sum()
    order = order[rank[order] >= 0]
    walls[:, 0], walls[:, 1] = rank[numbers[walls[:, 0]]], region + len(order)
    walls = summed_walls(walls[region >= 0])
    ends = np.arange(len(labels) + 1)
    return CountedLabels(
        labels,
        Part(
            np.concatenate((pieces[order], regions)),
            np.repeat((connectivity == 6, connectivity == 26), (len(order), len(regions))),
            walls,
            int(duals.sum()),
            (),
        ),
        np.searchsorted(owner_of_piece[order], ends),
        np.searchsorted(owner_of_region, ends) + len(order),
        np.searchsorted(owner_of_piece[order][walls[:, 0]], ends),
        duals,
        connectivity,
        grid,
    )


def _owners(values: NDArray[Any], nodes: Integers, labels: Integers) -> Integers:
    """The number of the label of each cell; −1 for those without one, and for cell 0 around the volume."""
    first = np.stack(np.unravel_index(nodes[1:, 1], [n + 2 for n in values.shape])) - 1
    found = values[tuple(first)].astype(np.int64)
    numbers = np.minimum(np.searchsorted(labels, found), len(labels) - 1)
    return np.concatenate(([-1], np.where(labels[numbers] == found, numbers, -1)))


def _walls(
    cells: NDArray[Any], owners: Integers, n_labels: int, connectivity: int
) -> tuple[Integers, Labels, Integers]:
    """The walls between cells, as rows of `Part.walls`; the forest of cells of one piece; and the sums of duals."""
    parents, duals = np.arange(len(owners), dtype=np.int32), np.zeros(n_labels, np.int64)
    sums = np.full((PLACES, 6), -1, np.int64)
    full = np.empty((max(_ROOM, 2 * _MOST_PAIRS * cells.shape[2]), 6), np.int64)
    walls, row, n_rows = [], 0, (cells.shape[0] - 1) * (cells.shape[1] - 1)
    while row < n_rows:
        row, n_full = wall_cells(
            cells, row, owners, connectivity == 6, parents, junction_tables(), duals, sums, full, _MOST_PAIRS
        )
        walls.append(summed_walls(full[:n_full].copy()))
    return np.concatenate((*walls, sums[sums[:, 0] >= 0])), parents, duals
