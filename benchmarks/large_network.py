"""A function of known topology on a very fine grid, block by block: seconds, memory, and how many points it takes.

    python benchmarks/large_network.py [--resolution 2048] [--nodes 4] [--radius 0.03] [--workers 0]

The solid is a scaffold: n³ nodes joined by rods along the axes, so its genus is 3n²(n − 1) − n³ + 1. Beside each node
hangs a pair of linked tori. CPU seconds are those of this process and of all workers together, memory is the peak of
each.
"""

from __future__ import annotations

import argparse
import resource
import time
from contextlib import ExitStack
from typing import Any

import torch
from torch import Tensor

import topokit as tk
from topokit.batch.files_on_dask import connected

EXTENT = 0.8


class Scaffold:
    """A signed distance: rods between the nodes of a cubic lattice, and two linked tori in each of its cells."""

    def __init__(self, n_nodes: int, radius: float) -> None:
        """Args: nodes along each axis, and the radius of rods and tori."""
        self.n_nodes, self.radius = n_nodes, radius
        self.step = 2 * EXTENT / (n_nodes - 1)

    def __call__(self, x: Tensor) -> Tensor:
        """Distance (N,) of points (N, 3)."""
        place = (x + EXTENT) / self.step
        from_node = (place - place.round().clamp(0, self.n_nodes - 1)) * self.step
        beyond = (x.abs() - EXTENT).clamp(min=0)
        squares, along = from_node.square(), beyond.square()
        rods = torch.stack([squares.sum(1) - squares[:, k] + along[:, k] for k in range(3)]).amin(0).sqrt()
        cell = (place.floor().clamp(0, self.n_nodes - 2) + 0.5 - place) * -self.step
        major = self.step / 7
        a, b, c = cell.unbind(1)
        one = torch.hypot(torch.hypot(a + major / 2, b) - major, c)
        other = torch.hypot(torch.hypot(a - major / 2, c) - major, b)
        return torch.minimum(torch.minimum(rods, one), other) - self.radius

    def known_betti(self) -> tuple[int, int, int]:
        """Components, tunnels and cavities of the solid."""
        n, n_cells = self.n_nodes, (self.n_nodes - 1) ** 3
        return 1 + 2 * n_cells, 3 * n * n * (n - 1) - n**3 + 1 + 2 * n_cells, 0


def used() -> tuple[float, int]:
    """CPU seconds and peak memory in MiB of this process."""
    return time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10


def main() -> None:
    """Count, compare and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--resolution", type=int, default=2048)
    parser.add_argument("--nodes", type=int, default=4)
    parser.add_argument("--radius", type=float, default=0.03)
    parser.add_argument("--block", type=int, default=128, help="grid points along each side of a block")
    parser.add_argument("--workers", type=int, default=0, help="processes of a local cluster; 0 is this process alone")
    given = parser.parse_args()
    solid = Scaffold(given.nodes, given.radius)
    with ExitStack() as stack:
        client: Any = stack.enter_context(connected("local", given.workers)) if given.workers else None
        before, started = used(), time.perf_counter()
        cpu_before = sum(seconds for seconds, _ in client.run(used).values()) if client else 0.0
        shape = tk.from_sdf(
            solid,
            bounds=((-1.0,) * 3, (1.0,) * 3),
            resolution=given.resolution,
            block_voxels=given.block**3,
            client=client,
        )
        report = shape.report()
        seconds, after = time.perf_counter() - started, used()
        workers = list(client.run(used).values()) if client else []
    print(report)
    assert report.solid_betti == solid.known_betti(), solid.known_betti()
    assert report.verdict == "likely"
    cpu = after[0] - before[0] + sum(one for one, _ in workers) - cpu_before
    n_full = (given.resolution + 1) ** 3
    print(f"{seconds:.0f} s, {cpu:.0f} CPU s; {n_full / 1e9:.2f}e9 points in the full grid")
    print(f"peak: {after[1]} MiB here ({before[1]} before), workers {[one for _, one in workers]} MiB")


if __name__ == "__main__":
    main()
