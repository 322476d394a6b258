"""From the part that is the whole volume to its closed surfaces, as `grid.components` finds them in memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

from topokit.core.blocks.part import Part
from topokit.core.grid.components import CountedVolume, ranked_surfaces
from topokit.core.grid.grid import Grid

Integers = NDArray[np.int64]

_SHARES = 4  # cubes that every voxel face lies in; and eighths of half of χ in a χ of a surface


def counted_volume(part: Part, connectivity: int, grid: Grid) -> CountedVolume:
    """What the part of a whole volume says about it.

    Args:
        part: of the volume with one layer of background around it.
        connectivity: 6 or 26, that of the solid.
        grid: of the volume without that layer.
    """
    is_solid = part.is_six == (connectivity == 6)
    order = np.lexsort(
        (part.nodes[:, 1], is_solid)
    )  # background first, each in the order of first voxels: 0 is outside
    nodes = part.nodes[order]
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    first, second = number[part.walls[:, :2]].T
    parent = _parents(len(nodes), first, second)
    child = np.where(parent[first] == second, first, second)
    sums = np.zeros((len(nodes), 4), dtype=np.int64)
    sums[child] = part.walls[:, 2:] // _SHARES  # a tree: every node but the outside has one wall to its parent
    spans = nodes[:, 2:].reshape(-1, 2, 3) - 1
    solid = nodes[np.sort(is_solid)]
    return CountedVolume(
        ranked_surfaces(parent, sums[:, 0], sums[:, 1:], spans[:, 0], spans[:, 1], nodes[:, 0], grid),
        euler=int(sums[:, 0].sum()),
        dual_euler=part.dual // _SHARES,
        n_inside=int(solid[:, 0].sum()),
        touched=tuple(
            (bool((solid[:, 2 + axis] == 1).any()), bool((solid[:, 5 + axis] == n + 1).any()))
            for axis, n in enumerate(grid.shape)
        ),
    )


def _parents(n_nodes: int, first: Integers, second: Integers) -> Integers:
    """The parent of every node of the adjacency tree, which is given by its edges; −1 for node 0, the outside."""
    edges = coo_array((np.ones(len(first), dtype=np.int8), (first, second)), shape=(n_nodes, n_nodes))
    found, parent = breadth_first_order(edges.tocsr(), 0, directed=False)
    if not len(found) == n_nodes == len(first) + 1:
        raise AssertionError(f"{n_nodes} regions with {len(first)} walls, {len(found)} of them joined, are no tree")
    parent = parent.astype(np.int64)
    parent[0] = -1
    return parent
