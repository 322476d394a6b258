"""Components, tunnels and cavities of a solid on a 3D grid, and which component lies inside which.

Conventions are those of `grid_euler`: the solid is {field > level} with connectivity 6 or 26, the background has the
other one, and there is only background outside the grid. With this pairing components and background regions form a
tree rooted at the outside (T. Y. Kong, A. Rosenfeld, "Digital topology: introduction and survey", CVGIP 48, 1989,
doi:10.1016/0734-189X(89)90147-3). Labelling is SciPy's and runs on the CPU.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage, sparse
from torch import Tensor

from topokit.core.grid.euler import DEFAULT_CONNECTIVITY, as_grid, critical_index, solid_euler
from topokit.errors import InputError

Integers = NDArray[np.int64]


@dataclass(frozen=True)
class GridComponent:
    """One component of a solid on a grid.

    Attributes:
        label: 1, 2, ... counting components.
        voxels: number of voxels.
        euler: Euler characteristic of the component's surface, cavity walls included: twice that of its solid.
        tunnels: first Betti number of the component's solid, which is the total genus of its surface.
        cavities: regions of background that the component encloses, whatever else may lie in them.
        box: ((x0, x1), (y0, y1), (z0, z1)) in voxels, ends excluded.
        inside: label of the component whose cavity this one lies in, the innermost if several; None if in none.
        touches_border: whether it reaches the first or the last layer of the grid along some axis.
    """

    label: int
    voxels: int
    euler: int
    tunnels: int
    cavities: int
    box: tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
    inside: int | None
    touches_border: bool


def betti_numbers(field: Tensor | ArrayLike, level: float = 0.0, connectivity: int = DEFAULT_CONNECTIVITY) -> Tensor:
    """Betti numbers of the solid {field > level}: components, tunnels, cavities.

    Its surface has b0 + b2 components with total genus b1.

    Args:
        field: (..., X, Y, Z), any real dtype but uint64, any device. NaN counts as background.
        level: voxels strictly above it are inside.
        connectivity: 6 or 26, that of the solid; its cavities are regions of the background under the other one.

    Returns:
        (..., 3) int64 tensor of b0, b1 = b0 + b2 - chi and b2, on the field's device.

    Raises:
        InputError: if the field has fewer than three axes, or the connectivity is neither 6 nor 26.
    """
    field = as_grid(field, connectivity)
    euler = solid_euler(field, level, connectivity)
    outer = []
    for item in np.ndindex(*euler.shape):
        inside = (field[item] > level).cpu().numpy()
        _, components = _label(inside, connectivity)
        _, regions = _label(~np.pad(inside, 1), 32 - connectivity)
        outer.append((components, regions - 1))
    b0, b2 = euler.new_tensor(outer).reshape(*euler.shape, 2).unbind(-1)
    return torch.stack((b0, b0 + b2 - euler, b2), dim=-1)


def grid_components(
    field: Tensor | ArrayLike, level: float = 0.0, connectivity: int = DEFAULT_CONNECTIVITY
) -> tuple[Tensor, list[GridComponent]]:
    """Components of the solid {field > level}, each with its own topology and its place among the others.

    Args:
        field: (X, Y, Z), any real dtype but uint64, any device. NaN counts as background.
        level: voxels strictly above it are inside.
        connectivity: 6 or 26, that of the solid.

    Returns:
        (X, Y, Z) tensor of labels on the CPU, 0 for background, and one entry for each label 1, 2, ...

    Raises:
        InputError: if the field does not have three axes, or the connectivity is neither 6 nor 26.
    """
    inside = (as_grid(field, connectivity) > level).cpu()
    if inside.dim() != 3:
        raise InputError(f"components are those of one field (X, Y, Z), not of shape {tuple(inside.shape)}")
    index = critical_index(inside, connectivity).numpy()
    labels, count = _label(inside.numpy(), connectivity)
    voxels = np.bincount(labels.ravel(), minlength=count + 1)
    euler = np.bincount(labels.ravel(), weights=index.ravel(), minlength=count + 1).astype(int)
    around, cavities = _nesting(labels, count, connectivity)
    table = [
        GridComponent(
            label=label,
            voxels=int(voxels[label]),
            euler=2 * int(euler[label]),
            tunnels=1 + int(cavities[label]) - int(euler[label]),
            cavities=int(cavities[label]),
            box=((x.start, x.stop), (y.start, y.stop), (z.start, z.stop)),
            inside=int(around[label]) or None,
            touches_border=any(s.start == 0 or s.stop == n for s, n in zip((x, y, z), labels.shape, strict=True)),
        )
        for label, (x, y, z) in enumerate(ndimage.find_objects(labels) if count else [], start=1)
    ]
    return torch.from_numpy(labels), table


def _nesting(labels: Integers, count: int, connectivity: int) -> tuple[Integers, Integers]:
    """For each label, entry 0 unused: the label of the component around it (0: none), and its number of cavities."""
    labels = np.pad(labels, 1)
    regions, region_count = _label(labels == 0, 32 - connectivity)
    nodes = np.where(labels > 0, labels, count + regions)
    outside = nodes[0, 0, 0]
    pairs = []
    for axis in range(3):
        layers = np.moveaxis(nodes, axis, 0)
        differ = layers[:-1] != layers[1:]
        pairs.append((layers[:-1][differ], layers[1:][differ]))
    lower, upper = np.concatenate(pairs, axis=1)
    size = count + region_count + 1
    graph = sparse.coo_array((np.ones(len(lower), dtype=bool), (lower, upper)), shape=(size, size)).tocsr()
    _, above = sparse.csgraph.breadth_first_order(graph, outside, directed=False)  # a tree: solid, region, solid, ...
    above[0] = outside
    around = np.maximum(above[above[: count + 1]], 0)  # the outside has nothing above it: a negative number
    enclosed = above[count + 1 :]
    cavities = np.bincount(enclosed[enclosed > 0], minlength=count + 1)
    return around, cavities


def _label(mask: NDArray[np.bool_], connectivity: int) -> tuple[Integers, int]:
    return ndimage.label(mask, structure=np.ones((3, 3, 3)) if connectivity == 26 else None)
