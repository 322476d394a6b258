"""The closed surfaces that bound a solid on a grid, one by one: outer walls and cavity walls, and what lies in what.

Conventions are those of `grid_euler`. Components of the solid and of the background form a tree whose root is the
background outside the grid; every other node is separated from the one above it by exactly one connected closed
surface, its outer wall. The index of `critical_index`, summed over a node, is half of χ of all of the node's walls:
its own and those of the nodes below it. So the walls follow from the leaves upward.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from topokit.core.components import SurfaceComponent
from topokit.core.grid.euler import critical_index

Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Nodes:
    """Components of the solid and of the background on the padded grid; entry 0 is the outside."""

    labels: NDArray[np.int32]
    count: int
    parent: Integers  # parent[0] = -1
    order: Integers  # parents before children
    index_sum: Integers
    boxes: list[tuple[slice, slice, slice]]


def grid_surfaces(
    inside: Tensor,
    connectivity: int,
    spacing: tuple[float, float, float],
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[SurfaceComponent, ...]:
    """The connected closed surfaces of the solid, largest area first.

    Args:
        inside: (X, Y, Z) bool.
        connectivity: 6 or 26, that of the solid.
        spacing: step along each axis.
        origin: position of the centre of the first voxel.

    Returns:
        One entry per surface, with exact χ, genus, nesting and bounding box (of the voxels, half a step around their
        centres). `area_share` counts the faces between voxels.
    """
    occupied = inside.nonzero()
    if len(occupied) == 0:
        return ()
    low, high = (corner.tolist() for corner in occupied.aminmax(dim=0))
    del occupied
    cropped = inside[low[0] : high[0] + 1, low[1] : high[1] + 1, low[2] : high[2] + 1]
    nodes = _nodes(np.pad(cropped.cpu().numpy(), 1), connectivity)
    euler, depth = _walls(nodes)
    areas = _wall_areas(nodes, spacing, depth)
    whole_area = areas.sum()
    ranked = sorted(range(1, nodes.count), key=lambda node: -areas[node])
    rank = {node: place for place, node in enumerate(ranked)}
    first = [low[axis] - 1.5 for axis in range(3)]  # the padded grid's corner, in voxels

    def component(node: int) -> SurfaceComponent:
        box = nodes.boxes[node]
        above = int(nodes.parent[node])
        corners = [
            tuple(origin[axis] + spacing[axis] * (first[axis] + getattr(box[axis], end)) for axis in range(3))
            for end in ("start", "stop")
        ]
        return SurfaceComponent(
            euler=int(euler[node]),
            genus=(2 - int(euler[node])) // 2,
            boundary_loops=0,
            bounds=(corners[0], corners[1]),
            area_share=float(areas[node] / whole_area),
            inside=rank[above] if above else None,
            depth=int(depth[node]) - 1,
        )

    return tuple(component(node) for node in ranked)


def _nodes(padded: NDArray[np.bool_], connectivity: int) -> _Nodes:
    solid, n_solid = _label(padded, connectivity)
    labels, n_background = _label(~padded, 32 - connectivity)
    # the outside is the first background region that a scan meets: it becomes 0, the others 1 ... , then the solids
    labels -= 1
    np.copyto(labels, solid + (n_background - 1), where=padded)
    count = n_background + n_solid
    first = _first_of_each(labels, count)
    parent = np.full(count, -1)
    before = np.asarray(np.unravel_index(first[1:], labels.shape))
    before[0] -= 1  # a node's first voxel lies on its outer wall: the voxel before it along x is its parent's
    parent[1:] = labels[tuple(before)]
    index_sum = _sum_of_index(padded, connectivity, labels, count) + _sum_of_index(
        ~padded, 32 - connectivity, labels, count
    )
    boxes = list(ndimage.find_objects(labels + 1))
    return _Nodes(labels, count, parent, np.argsort(first, kind="stable"), index_sum, boxes)


def _first_of_each(labels: NDArray[np.int32], count: int) -> Integers:
    """Flat index of the first voxel of every label."""
    flat = labels.ravel()
    starts = np.flatnonzero(np.diff(flat, prepend=-1))  # a label's first voxel starts a run
    first = np.empty(count, dtype=np.int64)
    first[flat[starts[::-1]]] = starts[::-1]  # the last one written is the first one there
    return first


def _sum_of_index(mask: NDArray[np.bool_], connectivity: int, labels: NDArray[np.int32], count: int) -> Integers:
    """Half of χ of each node's whole boundary; the padded grid's own border is no wall and is not counted for 0."""
    index = critical_index(torch.from_numpy(mask), connectivity).numpy().ravel()
    critical = np.flatnonzero((index != 0) & mask.ravel())
    return np.bincount(labels.ravel()[critical], weights=index[critical], minlength=count).astype(np.int64)


def _walls(nodes: _Nodes) -> tuple[Integers, Integers]:
    """χ of the outer wall of every node (meaningless for 0), and its depth in the tree."""
    euler = 2 * nodes.index_sum
    depth = np.zeros(nodes.count, dtype=np.int64)
    for node in nodes.order[1:]:
        depth[node] = depth[nodes.parent[node]] + 1
    for node in nodes.order[:0:-1]:
        if nodes.parent[node] > -1:
            euler[nodes.parent[node]] -= euler[node]
    return euler, depth


def _wall_areas(nodes: _Nodes, spacing: tuple[float, float, float], depth: Integers) -> NDArray[np.float64]:
    """Area of the voxel faces between every node and its parent."""
    areas = np.zeros(nodes.count)
    for axis in range(3):
        layers = np.moveaxis(nodes.labels, axis, 0)
        differ = layers[:-1] != layers[1:]
        lower, upper = layers[:-1][differ], layers[1:][differ]
        deeper = np.where(depth[lower] > depth[upper], lower, upper)
        areas += np.bincount(deeper, minlength=nodes.count) * (np.prod(spacing) / spacing[axis])
    return areas


def _label(mask: NDArray[np.bool_], connectivity: int) -> tuple[NDArray[np.int32], int]:
    return ndimage.label(mask, structure=np.ones((3, 3, 3)) if connectivity == 26 else None)
