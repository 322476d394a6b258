"""Components, tunnels and cavities of a solid on a 3D grid, the closed surfaces that bound it, and their nesting.

Conventions are those of `grid.euler`: the solid is {field > level} with connectivity 6 or 26, the background has the
other one, and there is only background outside the grid. With this pairing the components of solid and background form
a tree, the adjacency tree, whose root is the background outside the grid. Every other node is separated from its parent
by exactly one connected closed surface, its outer wall. Labeling is SciPy's and runs on the CPU.

Reference:
    T. Y. Kong, A. Rosenfeld, "Digital topology: introduction and survey", CVGIP 48, 1989,
    doi:10.1016/0734-189X(89)90147-3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from torch import Tensor

from topokit.core.components import CountedComponents, genus_of
from topokit.core.grid.euler import (
    DEFAULT_CONNECTIVITY,
    as_grid,
    critical_index,
    dual_connectivity,
    solid_euler,
    surface_euler,
)
from topokit.core.grid.grid import Grid
from topokit.errors import InputError

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Labels = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class CountedVolume:
    """What is counted in a whole volume.

    Attributes:
        surfaces: the connected closed surfaces of the solid, largest area first.
        euler: χ of the surface.
        dual_euler: χ of the surface of the same voxels under the other connectivity.
        n_inside: number of voxels of the solid.
        touched: for each axis, whether the solid is cut by the first and by the last layer.
    """

    surfaces: CountedComponents
    euler: int
    dual_euler: int
    n_inside: int
    touched: tuple[tuple[bool, bool], ...]


@dataclass(frozen=True, eq=False)
class _AdjacencyTree:
    """Components of the background, then those of the solid, as nodes 0, 1, ...; node 0 is the outside.

    Attributes:
        labels: (X, Y, Z), the node of every voxel.
        n_background: number of background nodes, which come first.
        count: number of nodes.
        parent: (count,); that of the outside is -1.
        connectivity: 6 or 26, that of the solid.
    """

    labels: Labels
    n_background: int
    count: int
    parent: Integers
    connectivity: int

    def half_euler_sums(self, of_solid: bool) -> Integers:
        """For each node of the solid, or of the background, half of χ of all its walls; 0 for the others.

        A wall is a connected closed surface between a node and its parent or one of its children. The grid's own border
        does not count as a wall of the outside.
        """
        mask = (self.labels >= self.n_background) == of_solid
        connectivity = self.connectivity if of_solid else dual_connectivity(self.connectivity)
        index = critical_index(torch.from_numpy(mask), connectivity).numpy().ravel()
        critical = np.flatnonzero((index != 0) & mask.ravel())
        sums = np.bincount(self.labels.ravel()[critical], weights=index[critical], minlength=self.count)
        return sums.astype(np.int64)


def betti_numbers(field: Tensor | ArrayLike, level: float = 0.0, connectivity: int = DEFAULT_CONNECTIVITY) -> Tensor:
    """Betti numbers of the solid {field > level}: components, tunnels, cavities.

    Its surface has b0 + b2 components with total genus b1.

    Args:
        field: (..., X, Y, Z), any real dtype but uint64, any device. NaN counts as background.
        level: voxels strictly above it are inside.
        connectivity: 6 or 26, that of the solid; its cavities are regions of the background under the other one.

    Returns:
        (..., 3) int64 tensor of b0, b1 = b0 + b2 - χ and b2, on the field's device.

    Raises:
        InputError: if the field has fewer than three axes, or the connectivity is neither 6 nor 26.
    """
    field = as_grid(field, connectivity)
    euler = solid_euler(field, level, connectivity)
    counts = []
    for item in np.ndindex(*euler.shape):
        inside = (field[item] > level).cpu().numpy()
        n_regions = _label(~np.pad(inside, 1), dual_connectivity(connectivity))[1]
        counts.append((_label(inside, connectivity)[1], n_regions - 1))
    b0, b2 = euler.new_tensor(counts).reshape(*euler.shape, 2).unbind(-1)
    return torch.stack((b0, b0 + b2 - euler, b2), dim=-1)


def betti_by_component(
    field: Tensor | ArrayLike, level: float = 0.0, connectivity: int = DEFAULT_CONNECTIVITY
) -> Tensor:
    """Betti numbers of each component of the solid {field > level} by itself, the largest component first.

    Args:
        field: (X, Y, Z), any real dtype but uint64, any device. NaN counts as background.
        level: voxels strictly above it are inside.
        connectivity: 6 or 26, that of the solid.

    Returns:
        (C, 3) int64 tensor on the CPU: 1, the tunnels and the cavities of each component.

    Raises:
        InputError: if the field does not have three axes, or the connectivity is neither 6 nor 26.
    """
    inside = (as_grid(field, connectivity) > level).cpu()
    if inside.dim() != 3:
        raise InputError(f"components are those of one field (X, Y, Z), not of shape {tuple(inside.shape)}.")
    tree = _adjacency_tree(np.pad(inside.numpy(), 1), connectivity)
    solid = slice(tree.n_background, None)
    cavities = np.bincount(tree.parent[1 : tree.n_background], minlength=tree.count)[solid]
    tunnels = 1 + cavities - tree.half_euler_sums(of_solid=True)[solid]
    voxels = np.bincount(tree.labels.ravel(), minlength=tree.count)[solid]
    table = np.stack((np.ones_like(tunnels), tunnels, cavities), axis=1)
    return torch.from_numpy(table[np.argsort(-voxels, kind="stable")])


def grid_surfaces(inside: Tensor, connectivity: int, grid: Grid) -> CountedComponents:
    """The connected closed surfaces of a solid on a grid, outer walls and cavity walls, largest area first.

    Args:
        inside: (X, Y, Z) bool.
        connectivity: 6 or 26, that of the solid.
        grid: where the centers of the voxels are.

    Returns:
        One row per surface, with exact χ, genus, nesting and bounding box (of the voxels, half a step around their
        centers). `area_shares` counts the faces between voxels.
    """
    if not inside.any():
        return CountedComponents.none()
    box = occupied_box(inside)
    padded = np.pad(inside[tuple(slice(*span) for span in box)].cpu().numpy(), 1)
    tree = _adjacency_tree(padded, connectivity)
    depth = depths(tree.parent)
    low, high = _spans(tree, [first - 1 for first, _ in box])
    voxels = np.bincount(tree.labels.ravel(), minlength=tree.count)
    return ranked_surfaces(tree.parent, _wall_eulers(tree, depth), _wall_faces(tree, depth), low, high, voxels, grid)


def ranked_surfaces(
    parent: Integers, euler: Integers, faces: Integers, low: Integers, high: Integers, voxels: Integers, grid: Grid
) -> CountedComponents:
    """The outer walls of the nodes of an adjacency tree, largest area first.

    Args:
        parent: (N,) of every node; that of node 0, the outside, is −1. Nodes of the background come first.
        euler: (N,) χ of their outer walls.
        faces: (N, 3) faces between voxels in these walls, across each axis.
        low: (N, 3) first voxel of each node along each axis.
        high: (N, 3) last + 1.
        voxels: (N,) in each node.
        grid: where the centers of the voxels are.
    """
    depth = depths(parent)
    steps = np.asarray(grid.spacing) / max(grid.spacing)
    areas = np.zeros(len(parent))
    for axis in range(3):
        areas += faces[:, axis] * (np.prod(steps) / steps[axis])
    ranked = 1 + np.argsort(-areas[1:], kind="stable")
    rank = np.full(len(parent), -1)
    rank[ranked] = np.arange(len(ranked))
    origin, spacing = np.asarray(grid.origin), np.asarray(grid.spacing)
    return CountedComponents(
        euler[ranked],
        genus_of(euler[ranked]),
        np.zeros_like(ranked),
        origin + spacing * (low[ranked] - 0.5),
        origin + spacing * (high[ranked] - 0.5),
        areas[ranked] / areas.sum(),
        rank[parent[ranked]],
        depth[ranked] - 1,
        voxels[ranked] * np.prod(spacing),
    )


def depths(parent: Integers) -> Integers:
    """Number of nodes above each node of a tree that is given by the parents, −1 at the root."""
    depth, above = np.zeros(len(parent), dtype=np.int64), parent
    while (has_parent := above >= 0).any():
        depth += has_parent
        above = np.where(has_parent, parent[above], -1)
    return depth


def counted_in_memory(inside: Tensor, connectivity: int, grid: Grid) -> CountedVolume:
    """What is counted in a solid (X, Y, Z) bool; arguments as for `grid_surfaces`."""
    ends = [[bool(inside.select(axis, end).any()) for end in (0, -1)] for axis in range(3)]
    return CountedVolume(
        grid_surfaces(inside, connectivity, grid),
        euler=int(surface_euler(inside, 0, connectivity)),
        dual_euler=int(surface_euler(inside, 0, dual_connectivity(connectivity))),
        n_inside=int(inside.sum()),
        touched=tuple((first, last) for first, last in ends),
    )


def occupied_box(inside: Tensor) -> list[tuple[int, int]]:
    """First and last + 1 of the layers along each axis that hold a voxel of a solid (X, Y, Z), which must have one."""
    box = []
    for axis in range(3):
        layers = inside.any(dim=[other for other in range(3) if other != axis]).nonzero()[:, 0]
        box.append((int(layers[0]), int(layers[-1]) + 1))
    return box


def _adjacency_tree(padded: Bools, connectivity: int) -> _AdjacencyTree:
    """The tree of a solid (X, Y, Z) with background in all outermost layers."""
    solid, n_solid = _label(padded, connectivity)
    labels, n_background = _label(~padded, dual_connectivity(connectivity))
    labels -= 1  # the outside is the first background region in scan order, so it becomes 0
    np.copyto(labels, solid + (n_background - 1), where=padded)
    count = n_background + n_solid
    parent = np.full(count, -1)
    before = np.asarray(np.unravel_index(_first_voxels(labels, count)[1:], labels.shape))
    before[0] -= 1  # a node's first voxel lies on its outer wall: the voxel before it along x belongs to its parent
    parent[1:] = labels[tuple(before)]
    return _AdjacencyTree(labels, n_background, count, parent, connectivity)


def _first_voxels(labels: Labels, count: int) -> Integers:
    """Flat index of the first voxel of every label in scan order."""
    flat = labels.ravel()
    starts = np.flatnonzero(np.diff(flat, prepend=-1))  # a label's first voxel starts a run
    first = np.empty(count, dtype=np.int64)
    first[flat[starts[::-1]]] = starts[::-1]  # of repeated indices the one written last remains: the first in the grid
    return first


def _wall_eulers(tree: _AdjacencyTree, depth: Integers) -> Integers:
    """χ of the outer wall of every node: that of all its walls minus its children's outer walls (meaningless for 0)."""
    euler = 2 * (tree.half_euler_sums(of_solid=True) + tree.half_euler_sums(of_solid=False))
    for level in range(int(depth.max()), 1, -1):
        nodes = np.flatnonzero(depth == level)
        np.subtract.at(euler, tree.parent[nodes], euler[nodes])
    return euler


def _wall_faces(tree: _AdjacencyTree, depth: Integers) -> Integers:
    """Number of voxel faces (count, 3) across each axis between every node and its parent."""
    faces = np.zeros((tree.count, 3), dtype=np.int64)
    for axis in range(3):
        layers = np.moveaxis(tree.labels, axis, 0)
        differ = layers[:-1] != layers[1:]
        lower, upper = layers[:-1][differ], layers[1:][differ]
        child = np.where(depth[lower] > depth[upper], lower, upper)
        faces[:, axis] = np.bincount(child, minlength=tree.count)
    return faces


def _spans(tree: _AdjacencyTree, first: list[int]) -> tuple[Integers, Integers]:
    """First and last + 1 voxel (count, 3) of every node; `first`: grid index of the tree's first voxel."""
    found: Integers = np.array(
        [[(span.start, span.stop) for span in box] for box in ndimage.find_objects(tree.labels + 1)]
    )
    offset = np.asarray(first)
    return found[..., 0] + offset, found[..., 1] + offset


def _label(mask: Bools, connectivity: int) -> tuple[Labels, int]:
    return ndimage.label(mask, structure=np.ones((3, 3, 3)) if connectivity == 26 else None)
