"""A gyroid of any size that is on no disk: a Dask array whose blocks are made when they are counted.

    python -m benchmarks.gyroid [--periods 32] [--period 64] [--curve]

With --curve it is counted at all levels. Betti numbers of n³ periods, closed at the ends of the volume, are polynomials
in n of third degree: those of smaller volumes, counted in memory, give them.
"""

from __future__ import annotations

import argparse
import resource
import time

import dask.array as da
import numpy as np
from numpy.typing import ArrayLike, NDArray

import topokit as tk
from topokit.core.blocks.curve import euler_curve

_KNOWN = (2, 3, 4, 5)  # periods along each axis of the volumes in memory
_BLOCK = 256


def gray_period(n_voxels: int) -> NDArray[np.uint8]:
    """One period of the gyroid's function as gray values around 127.5."""
    axis = (np.arange(n_voxels) + 0.5) * 2 * np.pi / n_voxels
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    wave = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    return np.rint(127.5 + 80 * wave).astype(np.uint8)


def known_betti(period: NDArray[np.uint8], n: int, levels: ArrayLike) -> NDArray[np.int64]:
    """Pieces, tunnels and cavities (levels, 3) of n³ periods."""
    counted = [euler_curve(np.tile(period, (k,) * 3)).at(levels).betti.ravel() for k in _KNOWN]
    powers = np.vander(np.array(_KNOWN, float), 4)
    of_n = np.vander([float(n)], 4) @ np.linalg.solve(powers, np.array(counted, float))
    return np.rint(of_n).astype(np.int64).reshape(-1, 3)


def main() -> None:
    """Count, compare, and print CPU seconds and memory."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--periods", type=int, default=32, help="along each axis")
    parser.add_argument("--period", type=int, default=64, help="voxels, of which 256 are a multiple")
    parser.add_argument("--curve", action="store_true", help="all levels instead of one")
    given = parser.parse_args()
    period, side, level = gray_period(given.period), given.periods * given.period, 120.0
    levels = np.arange(256) if given.curve else [level]
    expected = known_betti(period, given.periods, levels)
    block = np.tile(period, (_BLOCK // given.period,) * 3)
    whole = da.map_blocks(
        lambda block_info: block[tuple(slice(b - a) for a, b in block_info[None]["array-location"])].copy(),
        chunks=da.core.normalize_chunks((_BLOCK,) * 3, (side,) * 3),
        dtype=np.uint8,
    )
    shape, started = tk.from_voxels(whole, level=level), time.process_time()
    found = shape.euler_curve(levels).betti if given.curve else np.array([shape.report().solid_betti])
    seconds, peak = time.process_time() - started, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    differing = int((found != expected).any(axis=1).sum())
    print(f"{side}³ voxels: at most {found.max(axis=0)}; {differing} of {len(found)} levels differ; ", end="")
    print(f"{seconds:.0f} CPU s, at most {peak} MiB")
    assert not differing


if __name__ == "__main__":
    main()
