"""A gyroid of any size that is on no disk: a Dask array whose blocks are made when they are counted.

    python -m benchmarks.gyroid [--periods 32] [--period 64]

Betti numbers of n³ periods, closed at the ends of the volume, are polynomials in n of third degree: those of smaller
volumes, counted in memory, give them.
"""

from __future__ import annotations

import argparse
import resource
import time

import dask.array as da
import numpy as np
from numpy.typing import NDArray

import topokit as tk

_KNOWN = (2, 3, 4, 5)  # periods along each axis of the volumes in memory
_BLOCK = 256


def gray_period(n_voxels: int) -> NDArray[np.uint8]:
    """One period of the gyroid's function as gray values around 127.5."""
    axis = (np.arange(n_voxels) + 0.5) * 2 * np.pi / n_voxels
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    wave = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    return np.rint(127.5 + 80 * wave).astype(np.uint8)


def known_betti(period: NDArray[np.uint8], n: int, level: float) -> tuple[int, ...]:
    """Pieces, tunnels and cavities of n³ periods."""
    counted = [tk.from_voxels(np.tile(period, (k,) * 3), level=level).report().solid_betti for k in _KNOWN]
    powers = np.vander(np.array(_KNOWN, float), 4)
    return tuple(round(float(np.polyval(np.linalg.solve(powers, row), n))) for row in np.array(counted, float).T)


def main() -> None:
    """Count, compare, and print CPU seconds and memory."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--periods", type=int, default=32, help="along each axis")
    parser.add_argument("--period", type=int, default=64, help="voxels, of which 256 are a multiple")
    given = parser.parse_args()
    period, side, level = gray_period(given.period), given.periods * given.period, 120.0
    expected = known_betti(period, given.periods, level)
    block = np.tile(period, (_BLOCK // given.period,) * 3)
    whole = da.map_blocks(
        lambda block_info: block[tuple(slice(b - a) for a, b in block_info[None]["array-location"])].copy(),
        chunks=da.core.normalize_chunks((_BLOCK,) * 3, (side,) * 3),
        dtype=np.uint8,
    )
    started = time.process_time()
    report = tk.from_voxels(whole, level=level).report()
    seconds, peak = time.process_time() - started, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    print(f"{side}³ voxels: {report.solid_betti}, expected {expected}; {seconds:.0f} CPU s, at most {peak} MiB")
    assert (report.solid_betti, report.verdict) == (expected, "certain")


if __name__ == "__main__":
    main()
