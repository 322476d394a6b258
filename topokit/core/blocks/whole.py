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

import numpy as np
from torch import Tensor

from topokit.core.arrays import Booleans, Integers
from topokit.core.blocks.division import MOST_VOXELS, Box, Division
from topokit.core.blocks.part import Part, count_box, join_parts
from topokit.core.blocks.planes import hang_leaves
from topokit.core.components import CountedComponents, genus_of
from topokit.core.grid.grid import Grid

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
    is_solid = part.is_six == (connectivity == 6)
    order = np.lexsort(
        (part.nodes[:, 1], is_solid)
    )  # background first, each in the order of first voxels: 0 is outside
    nodes, is_solid = part.nodes[order], is_solid[order]
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    first, second = number[part.walls[:, :2]].T
    parent = _parents(len(nodes), first, second)
    child = np.where(parent[first] == second, first, second)
    sums = np.zeros((len(nodes), 4), dtype=np.int64)
    sums[child] = part.walls[:, 2:] // _SHARES  # a tree: every node but the outside has one wall to its parent
    spans = nodes[:, 2:].reshape(-1, 2, 3) - 1
    solid = nodes[is_solid]
    return CountedVolume(
        _surfaces(parent, sums[:, 0], sums[:, 1:], spans[:, 0], spans[:, 1], nodes, grid),
        _solid_betti(parent, sums[:, 0], nodes[:, 0], is_solid),
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
    parent = np.full(n_nodes, -1)
    hang_leaves(first, second, parent)
    if not (parent >= 0).sum() == n_nodes - 1 == len(first):
        raise AssertionError(
            f"{n_nodes} regions with {len(first)} walls, {(parent >= 0).sum()} of them joined: no tree"
        )
    return parent


def _surfaces(
    parent: Integers, euler: Integers, faces: Integers, low: Integers, high: Integers, nodes: Integers, grid: Grid
) -> CountedComponents:
    """The outer walls of the nodes of an adjacency tree, largest area first.

    Args:
        parent: (N,) of every node; that of node 0, the outside, is −1. Nodes of the background come first.
        euler: (N,) χ of their outer walls.
        faces: (N, 3) faces between voxels in these walls, across each axis.
        low: (N, 3) first voxel of each node along each axis.
        high: (N, 3) last + 1.
        nodes: (N, 8) rows of `NODE_COLUMNS`.
        grid: where the centers of the voxels are.
    """
    steps = np.asarray(grid.spacing) / max(grid.spacing)
    areas = np.zeros(len(parent))
    for axis in range(3):
        areas += faces[:, axis] * (np.prod(steps) / steps[axis])
    ranked = 1 + np.argsort(-areas[1:], kind="stable")
    rank = np.full(len(parent), -1)
    rank[ranked] = np.arange(len(ranked))
    origin, spacing = np.asarray(grid.origin), np.asarray(grid.spacing)
    first = np.stack(np.unravel_index(nodes[ranked, 1], [n + 2 for n in grid.shape]), axis=1) - 1
    return CountedComponents(
        euler[ranked],
        genus_of(euler[ranked]),
        np.zeros_like(ranked),
        origin + spacing * (low[ranked] - 0.5),
        origin + spacing * (high[ranked] - 0.5),
        areas[ranked] / areas.sum(),
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


def _solid_betti(parent: Integers, euler: Integers, voxels: Integers, is_solid: Booleans) -> Integers:
    """Betti numbers (C, 3) of the components of the solid: its cavities are its children in the adjacency tree.

    χ of a component is half of χ of its walls, which are its own outer wall and those of its cavities.
    """
    inner = np.zeros_like(euler)
    np.add.at(inner, parent[1:], euler[1:])
    cavities = np.bincount(parent[1:], minlength=len(parent))
    tunnels = 1 + cavities - (euler + inner) // 2
    table = np.stack((np.ones_like(tunnels), tunnels, cavities), axis=1)[is_solid]
    return table[np.argsort(-voxels[is_solid], kind="stable")]
