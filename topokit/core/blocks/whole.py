"""From the counted parts of a volume to the closed surfaces of its solid and their nesting.

Conventions are those of `grid.euler`: the solid is 6- or 26-connected, the background has the other connectivity, and
there is only background outside the grid. With this pairing the components of solid and background form a tree, the
adjacency tree, whose root is the background outside the grid. Every other node is separated from its parent by exactly
one connected closed surface, its outer wall.

Reference:
    T. Y. Kong, A. Rosenfeld, "Digital topology: introduction and survey", CVGIP 48, 1989,
    doi:10.1016/0734-189X(89)90147-3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from topokit.core.arrays import Booleans, Integers
from topokit.core.blocks.division import MOST_VOXELS, Box, Division
from topokit.core.blocks.part import Part, count_box, join_parts
from topokit.core.blocks.planes import hang_leaves
from topokit.core.components import CountedComponents
from topokit.core.genus import genus_of
from topokit.core.grid.grid import Grid
from topokit.core.labels import inverse_order

_SHARES = 4  # cubes that every voxel face lies in; and eighths of half of χ in a χ of a surface


@dataclass(frozen=True, eq=False)
class CountedVolume:
    """What is counted in a whole volume.

    Attributes:
        surfaces: the connected closed surfaces of the solid, outer walls and walls of cavities, largest area first. The
            boxes are those of the voxels, half a step around their centers; `area_shares` counts faces between voxels.
        solid_betti: (C, 3), components (1), tunnels and cavities of each component of the solid, most voxels first.
        euler: χ of the surface.
        dual_euler: χ of the surface of the same voxels under the other connectivity.
        n_inside: number of voxels of the solid.
        touched: for each axis, whether the solid is cut by the first and by the last layer.
    """

    surfaces: CountedComponents
    solid_betti: Integers
    euler: int
    dual_euler: int
    n_inside: int
    touched: tuple[tuple[bool, bool], ...]


def count_solid(values: Tensor, is_inside: Callable[[Tensor], Tensor], connectivity: int, grid: Grid) -> CountedVolume:
    """What is counted in a solid on a grid, one block after the other, on the CPU.

    Args:
        values: (X, Y, Z), any device.
        is_inside: which of some values are in the solid, bool of the same shape.
        connectivity: 6 or 26, that of the solid.
        grid: where the centers of the voxels are.
    """

    def count(box: Box) -> Part:
        block = values[tuple(slice(*side) for side in box)]
        return count_box(is_inside(block).cpu().numpy(), box, grid.shape, connectivity)

    return counted_volume(Division.even(grid.shape, MOST_VOXELS).reduce(count, join_parts), connectivity, grid)


def counted_volume(part: Part, connectivity: int, grid: Grid) -> CountedVolume:
    """What the part of a whole volume says about it.

    Args:
        part: of the volume with one layer of background around it.
        connectivity: 6 or 26, that of the solid.
        grid: of the volume without that layer.
    """
    [counted] = counted_volumes(part, np.zeros(len(part.nodes), np.int64), np.array([part.dual]), connectivity, grid)
    return counted


def counted_volumes(
    part: Part, owners: Integers, duals: Integers, connectivity: int, grid: Grid
) -> list[CountedVolume]:
    """What the parts of several whole volumes on one grid say about them.

    Args:
        part: all parts together.
        owners: (N,) the number of the volume of each of its nodes.
        duals: (V,) sum of `CubeTables.dual` in each volume.
        connectivity: 6 or 26, that of the solids.
        grid: of each volume without its layer of background.
    """
    is_solid = part.is_six == (connectivity == 6)
    # Of each volume the background first, each in the order of first voxels: so the outside is the first node.
    order = np.lexsort((part.nodes[:, 1], is_solid, owners))
    nodes, is_solid, owners = part.nodes[order], is_solid[order], owners[order]
    starts = np.searchsorted(owners, np.arange(len(duals) + 1))
    first, second = np.ascontiguousarray(inverse_order(order)[part.walls[:, :2]].T)
    parent = _parents(starts[:-1], len(nodes), first, second)
    child = np.where(parent[first] == second, first, second)
    sums = np.zeros((len(nodes), 4), dtype=np.int64)
    sums[child] = part.walls[:, 2:] // _SHARES  # every node but the outside has one wall to its parent
    surfaces = _surfaces(parent, sums, nodes, owners, starts, grid)
    eulers = np.add.reduceat(sums[:, 0], starts[:-1]).tolist()
    betti, solid = _solid_betti(parent, sums[:, 0], nodes[:, 0], is_solid, owners), nodes[is_solid]
    ends = np.searchsorted(owners[is_solid], np.arange(len(duals) + 1))
    n_inside = _sums(solid[:, 0], ends).tolist()
    low, high = _sums(solid[:, 2:5] == 1, ends), _sums(solid[:, 5:] == np.array(grid.shape) + 1, ends)
    touched = (np.stack((low, high), axis=2) > 0).tolist()
    return [
        CountedVolume(
            surfaces.rows(slice(starts[k] - k, starts[k + 1] - k - 1)),  # no surface is that of an outside
            betti[ends[k] : ends[k + 1]],
            euler=eulers[k],
            dual_euler=dual // _SHARES,
            n_inside=n_inside[k],
            touched=tuple((before, after) for before, after in touched[k]),
        )
        for k, dual in enumerate(duals.tolist())
    ]


def _sums(values: NDArray[Any], ends: Integers) -> Integers:
    """Sums of the rows from each end to the next, which may be none."""
    totals = np.concatenate((np.zeros((1, *values.shape[1:]), np.int64), np.cumsum(values, axis=0)))
    return np.diff(totals[ends], axis=0)


def _parents(roots: Integers, n_nodes: int, first: Integers, second: Integers) -> Integers:
    """The parent of every node of the adjacency trees, which are given by their edges; −1 for the roots, outside."""
    parent, is_root = np.full(n_nodes, -1), np.zeros(n_nodes, bool)
    is_root[roots] = True
    hang_leaves(first, second, is_root, parent)
    if not (parent >= 0).sum() == n_nodes - len(roots) == len(first):
        raise AssertionError(
            f"{n_nodes} regions with {len(first)} walls, {(parent >= 0).sum()} of them joined: not {len(roots)} trees"
        )
    return parent


def _surfaces(
    parent: Integers, sums: Integers, nodes: Integers, owners: Integers, starts: Integers, grid: Grid
) -> CountedComponents:
    """The outer walls of the nodes of adjacency trees, tree after tree, in each the largest area first.

    Args:
        parent: (N,) of every node; −1 for that of the outside, the first node of each tree.
        sums: (N, 4) χ of their outer walls, and the faces between voxels in these, across each axis.
        nodes: (N, 8) rows of `NODE_COLUMNS`.
        owners: (N,) ascending, the number of the tree.
        starts: (V + 1,) where each tree starts, and N.
        grid: where the centers of the voxels are.
    """
    steps = np.asarray(grid.spacing) / max(grid.spacing)
    areas = np.zeros(len(parent))
    for axis in range(3):
        areas += sums[:, 1 + axis] * (np.prod(steps) / steps[axis])
    order = np.lexsort((-areas, parent >= 0, owners))
    rank = inverse_order(order) - starts[owners] - 1  # −1 for the outside
    ranked = order[parent[order] >= 0]
    origin, spacing = np.asarray(grid.origin), np.asarray(grid.spacing)
    spans = origin + spacing * (nodes[ranked, 2:].reshape(-1, 2, 3) - 1.5)
    euler = sums[ranked, 0]
    first = np.stack(np.unravel_index(nodes[ranked, 1], [n + 2 for n in grid.shape]), axis=1) - 1
    return CountedComponents(
        euler,
        genus_of(euler),
        np.zeros_like(ranked),
        spans[:, 0],
        spans[:, 1],
        areas[ranked] / np.add.reduceat(areas, starts[:-1])[owners[ranked]],
        rank[parent[ranked]],
        _depths(parent)[ranked] - 1,
        nodes[ranked, 0] * np.prod(spacing),
        origin + spacing * first,
    )


def _depths(parent: Integers) -> Integers:
    """Number of nodes above each node of a tree that is given by the parents, −1 at the root."""
    depth, above = np.zeros(len(parent), dtype=np.int64), parent
    while (has_parent := above >= 0).any():
        depth += has_parent
        above = np.where(has_parent, parent[above], -1)
    return depth


def _solid_betti(parent: Integers, euler: Integers, voxels: Integers, is_solid: Booleans, owners: Integers) -> Integers:
    """Betti numbers (C, 3) of the components of solids: the cavities of one are its children in the adjacency tree.

    χ of a component is half of χ of its walls, which are its own outer wall and those of its cavities.
    """
    inner, has_parent = np.zeros_like(euler), parent >= 0
    np.add.at(inner, parent[has_parent], euler[has_parent])
    cavities = np.bincount(parent[has_parent], minlength=len(parent))
    tunnels = 1 + cavities - (euler + inner) // 2
    table = np.stack((np.ones_like(tunnels), tunnels, cavities), axis=1)[is_solid]
    return table[np.lexsort((-voxels[is_solid], owners[is_solid]))]
