"""A zarr volume of known topology, counted block by block: seconds against reading alone, memory, one worker and two.

    python benchmarks/large_volume.py FOLDER [--side 512] [--gray] [--block 256] [--workers 1 2]

The volume is made once: a solid with a lattice of crossing tunnels, and in every cell of the lattice a cavity with a
ball in it, so that all Betti numbers are known by a formula. With --gray its values are noisy and compress badly, as
those of a scanner do. CPU seconds are those of all workers together: other programs do not change them much. Memory is
the peak of each worker, with torch, SciPy and numba in it.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from dask.distributed import Client, LocalCluster
from numpy.typing import NDArray

import topokit as tk
from topokit.adapters.voxels.counting import BlockCount, Solid
from topokit.adapters.voxels.periodic_or_cut_out import Ends
from topokit.adapters.voxels.stored_volumes import IndexedVolume
from topokit.core.blocks.division import Box, Division
from topokit.core.blocks.on_dask import reduced

PERIOD = 128
TUNNEL, CAVITY, BALL = 20, 14, 7  # radii in voxels
CHUNK = 128


def cell() -> NDArray[np.bool_]:
    """One period of the solid: tunnels along the axes through its middle, a cavity near its corner, a ball in that."""
    x, y, z = np.ogrid[:PERIOD, :PERIOD, :PERIOD]
    a, b, c = ((axis - PERIOD / 2 + 0.5) ** 2 for axis in (x, y, z))
    from_corner = sum((axis - 20) ** 2 for axis in (x, y, z))
    in_tunnel = (a + b < TUNNEL**2) | (b + c < TUNNEL**2) | (a + c < TUNNEL**2)
    return ~in_tunnel & ((from_corner > CAVITY**2) | (from_corner < BALL**2))


def known_betti(n_cells: int) -> tuple[int, int, int]:
    """Components, tunnels and cavities of a cube of cells.

    The tunnels are a thickened graph N with n³ crossings and 6 n² ends; χ(solid) = 1 + χ(N) − 6 n², with χ(N) = 3 n² −
    2 n³, before cavities and balls.
    """
    return 1 + n_cells**3, 3 * n_cells**2 + 2 * n_cells**3, n_cells**3


def make(path: Path, side: int, is_gray: bool) -> None:
    """Write the volume, a layer of chunks at a time."""
    solid = cell()
    generator = np.random.default_rng(0)
    tiles = (side // PERIOD,) * 3
    array = zarr.create_array(path, shape=(side,) * 3, chunks=(CHUNK,) * 3, dtype="uint8")
    for place in np.ndindex(*tiles):
        values = solid * np.uint8(255)
        if is_gray:
            noise = generator.integers(0, 64, solid.shape, dtype=np.uint8)
            values = np.where(solid, 190 - noise, 20 + noise)
        array[tuple(slice(PERIOD * k, PERIOD * (k + 1)) for k in place)] = values


def size_of(source: Any, block: Box) -> int:
    """Read a block and forget it."""
    return source().size


def add(one: int, other: int, axis: int) -> int:
    """The voxels of two boxes."""
    return one + other


def cpu_seconds(client: Client) -> float:
    """CPU time of all workers so far."""
    return sum(client.run(time.process_time).values())


def peak_memory() -> int:
    """Of this process in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10


def measure(path: Path, n_workers: int, block: int) -> None:
    """One line of the table."""
    stored = IndexedVolume(zarr.open_array(path, mode="r"))
    n_cells = stored.shape[0] // PERIOD
    with (
        LocalCluster(n_workers=n_workers, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        client.run(warm_up)
        before = max(client.run(peak_memory).values())
        division = Division.of(stored.chunks, block**3)
        cpu, started = cpu_seconds(client), time.perf_counter()
        assert reduced(division, stored.at, size_of, add, client, int) == stored.n_voxels
        reading, reading_cpu = time.perf_counter() - started, cpu_seconds(client) - cpu
        cpu, started = cpu_seconds(client), time.perf_counter()
        report = tk.from_voxels(stored._array, level=100, block_voxels=block**3, client=client).report()
        counting, counting_cpu = time.perf_counter() - started, cpu_seconds(client) - cpu
        peak = max(client.run(peak_memory).values())
    assert report.solid_betti == known_betti(n_cells), report
    assert report.verdict == "certain"
    gibibytes = stored.n_voxels / 2**30
    print(
        f"{n_workers:>7}{reading:>10.1f}{reading_cpu:>10.1f}{counting:>10.1f}{counting_cpu:>10.1f}"
        f"{counting_cpu / reading_cpu:>8.1f}{counting_cpu / gibibytes:>9.2f}{before:>8}{peak:>8}",
        flush=True,
    )


def warm_up() -> None:
    """Load what counting needs into a worker."""
    work = BlockCount(Solid(0, (), 26), (4, 4, 4), Ends())
    halves = [work.count(np.ones((2, 4, 4), np.uint8), ((start, start + 2), (0, 4), (0, 4))) for start in (0, 2)]
    from topokit.adapters.voxels.counting import joined

    joined(halves[0], halves[1], 0)


def main() -> None:
    """Make the volume if it is not there, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--side", type=int, default=512, help=f"voxels along each axis, a multiple of {PERIOD}")
    parser.add_argument("--gray", action="store_true", help="noisy values instead of 0 and 255")
    parser.add_argument("--block", type=int, default=256, help="voxels along each side of a block")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    given = parser.parse_args()
    path = given.folder / f"{'gray' if given.gray else 'binary'}-{given.side}.zarr"
    if not path.exists():
        started = time.process_time()
        make(path, given.side, given.gray)
        print(f"made {path} in {time.process_time() - started:.0f} CPU s")
    size = sum(part.stat().st_size for part in path.rglob("*") if part.is_file())
    print(f"{given.side}³ voxels, {size / 2**20:.0f} MiB on disk, Betti numbers {known_betti(given.side // PERIOD)}")
    print(f"{os.cpu_count()} cores; wall and CPU seconds of reading alone and of counting; MiB before and at the peak")
    print(" workers   reading       CPU  counting       CPU   ratio  CPU/GiB  before    peak")
    for n_workers in given.workers:
        measure(path, n_workers, given.block)


if __name__ == "__main__":
    main()
