"""Boxes whose ends are no ends: Δχ of blocks beside that of the whole, and periodic cells of minimal surfaces.

python -m benchmarks.boxes
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from topokit.core.blocks.periodic import count_periodic
from topokit.core.grid.minkowski import cube_counts, euler_of

_SIDE = 48  # cells of a volume along an axis; it has one voxel more
_PERIOD = 24

Wave = NDArray[np.float64]
# Sides of the surfaces, and how many primitive cells, each with χ = −4 and so of genus 3, the cubic one has.
SURFACES: dict[str, tuple[int, Callable[[Wave, Wave, Wave], Wave]]] = {
    "P": (1, lambda x, y, z: np.cos(x) + np.cos(y) + np.cos(z)),
    "D": (4, lambda x, y, z: np.cos(x) * np.cos(y) * np.cos(z) - np.sin(x) * np.sin(y) * np.sin(z)),
    "G": (2, lambda x, y, z: np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)),
}


def volumes() -> list[NDArray[np.bool_]]:
    """Seven smooth random solids, and three of independent voxels."""
    random = np.random.default_rng(0)
    shape = (_SIDE + 1,) * 3
    smooth = [gaussian_filter(random.normal(size=shape), 1.5) > 0 for _ in range(7)]
    return [*smooth, *(random.random(shape) < share for share in (0.3, 0.5, 0.7))]


def sum_of_blocks(inside: NDArray[np.bool_], n_blocks: int, connectivity: int) -> float:
    """The sum of Δχ over blocks that share their end layers, so many along each axis."""
    ends = [slice(low, high + 1) for low, high in pairwise(_SIDE * k // n_blocks for k in range(n_blocks + 1))]
    return sum(euler_of(cube_counts(inside[box]), connectivity) for box in product(ends, repeat=3))


def main() -> None:
    """Print how many sums differ, and the genus of cells and of 2 × 2 × 2 and 3 × 3 × 3 of them."""
    cases = [(inside, n, connectivity) for inside in volumes() for n in (2, 3, 4) for connectivity in (6, 26)]
    n_wrong = sum(sum_of_blocks(*case) != euler_of(cube_counts(case[0]), case[2]) for case in cases)
    print(f"Δχ of 8, 27 and 64 blocks of ten volumes: {n_wrong} of {len(cases)} sums differ from the whole")
    axis = (np.arange(_PERIOD) + 0.5) * 2 * np.pi / _PERIOD
    for name, (n_primitive, wave) in SURFACES.items():
        cell = wave(*np.meshgrid(axis, axis, axis, indexing="ij")) > 0
        for repeats in (1, 2, 3):
            found = count_periodic(np.tile(cell, (repeats,) * 3), 6, (True,) * 3)
            euler = 2 * found.euler / (n_primitive * repeats**3)
            print(f"{name}, {repeats}³ cells: genus {found.genus}, χ {euler:g} of the surface in a primitive cell")
            assert (euler, found.n_surfaces) == (-4, 1)
    assert n_wrong == 0


if __name__ == "__main__":
    main()
