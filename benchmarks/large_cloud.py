"""A cloud of known topology, larger than what is held in memory: seconds against reading alone, memory, workers.

    python benchmarks/large_cloud.py FOLDER [--points 1000000 10000000 100000000] [--workers 0 2] [--suffix .npy]

The cloud is made once: samples of a surface of genus 3 in random order, the worst one, without normals, in single
precision; with noise of 1/1000 of its length, one point in a thousand anywhere in its box, one in a hundred thousand
NaN, and one a million lengths away. Every line of the table is a process of its own, or a cluster of worker processes
(with 0 workers: none), so that its peak of memory is its own. CPU seconds are those of all processes together: other
programs do not change them much.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import topokit as tk
from topokit.adapters.points.entry import FORMATS
from topokit.adapters.points.larger_than_memory import MOST_AT_ONCE
from topokit.core.processors import n_cores
from topokit.inputs.formats import stored_in
from topokit.testing import genus_mesh

GENUS, NOISE, HAZE, LOST = 3, 1e-3, 1_000, 100_000
PART = 1 << 21  # points that are made at once


def make(path: Path, n_points: int) -> None:
    """Write the cloud; .npy by parts, other formats (for smaller ones) as a whole."""
    vertices, faces = genus_mesh(GENUS)
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    reached = np.cumsum(areas) / areas.sum()
    low, size = vertices.min(0), np.ptp(vertices, axis=0)
    generator = np.random.default_rng(0)
    target = np.lib.format.open_memmap(path.with_suffix(".npy"), "w+", np.dtype("<f4"), (n_points, 3))
    for start in range(0, n_points, PART):
        count = min(PART, n_points - start)
        corner = corners[np.searchsorted(reached, generator.random(count))]
        a, b = generator.random((2, count, 1))
        a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
        points = corner[:, 0] + a * (corner[:, 1] - corner[:, 0]) + b * (corner[:, 2] - corner[:, 0])
        points += NOISE * size.max() * generator.standard_normal(points.shape)
        points[::HAZE] = low + size * generator.random(points[::HAZE].shape)
        points[1::LOST] = np.nan
        target[start : start + count] = points
    target[0] = 1e6 * size
    target.flush()
    del target
    if path.suffix == ".npy":
        return
    import laspy

    points = np.load(path.with_suffix(".npy")).astype(np.float64)
    points = points[np.isfinite(points).all(1)][1:]
    file = laspy.create(point_format=0, file_version="1.2")
    file.header.scales = [1e-5 * size.max()] * 3
    file.x, file.y, file.z = points.T
    file.write(str(path))


def timed(work: Callable[[], Any], cpu: Callable[[], float]) -> tuple[Any, float, float]:
    """What some work gives, its wall and its CPU seconds."""
    before, started = cpu(), time.perf_counter()
    found = work()
    return found, time.perf_counter() - started, cpu() - before


def peak_memory() -> int:
    """Of this process in MiB, on Linux; `getrusage` would include that of the process that started it."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) >> 10


def read_alone(path: Path) -> int:
    """Read all blocks and forget them."""
    cloud = stored_in(FORMATS, path)
    assert cloud is not None
    return sum(len(part) for block in cloud.blocks(MOST_AT_ONCE) for part, _ in cloud.read(block, MOST_AT_ONCE))


def measure(path: Path, client: Any = None) -> dict[str, Any]:
    """One line of the table, but for the names."""

    def cpu() -> float:
        return time.process_time() + (0 if client is None else sum(client.run(time.process_time).values()))

    tk.from_points(np.random.default_rng(0).normal(size=(100, 3)))  # loads torch
    before = peak_memory()
    n_points, *reading = timed(lambda: read_alone(path), cpu)
    shape, *reducing = timed(lambda: tk.from_points(path, block_points=MOST_AT_ONCE, client=client), cpu)
    peak = max([peak_memory()] if client is None else client.run(peak_memory).values())
    report, *looking = timed(shape.report, cpu)
    assert report.genus == GENUS, report
    return {
        "n": n_points,
        "reading": reading,
        "reducing": reducing,
        "report": looking,
        "kept": shape.samples.n_points,
        "verdict": report.verdict,
        "digest": hashlib.sha256(shape.samples.points.numpy().tobytes()).hexdigest()[:12],
        "before": before,
        "peak": peak,
        "end": peak_memory(),
    }


def measure_with(path: Path, n_workers: int) -> None:
    """A line as JSON, in this process or with workers."""
    if n_workers == 0:
        found = measure(path)
    else:
        from topokit.batch.files_on_dask import connected

        with connected("local", n_workers) as client:
            found = measure(path, client)
    print(json.dumps(found))


def main() -> None:
    """Make the clouds that are not there, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--points", type=int, nargs="+", default=[10**6, 10**7, 10**8])
    parser.add_argument("--workers", type=int, nargs="+", default=[0])
    parser.add_argument("--suffix", default=".npy", choices=[".npy", ".las", ".laz"])
    parser.add_argument("--line", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.line:
        measure_with(given.folder, given.workers[0])
        return
    print(f"{n_cores()} cores; wall and CPU seconds; memory in MiB: before, at the peak of reducing, at the end")
    print("     points workers   reading     reducing    ns/point  ratio      report    kept  digest        MiB")
    for n_points in given.points:
        path = given.folder / f"genus-{GENUS}-{n_points}{given.suffix}"
        if not path.exists():
            make(path, n_points)
        for n_workers in given.workers:
            command = [sys.executable, __file__, str(path), "--line", "--workers", str(n_workers)]
            line = subprocess.run(command, check=True, stdout=subprocess.PIPE, env=dict(os.environ)).stdout
            found = json.loads(line.splitlines()[-1])
            reading, reducing, report = (found[name] for name in ("reading", "reducing", "report"))
            seconds = f"{reading[0]:>6.1f}{reading[1]:>6.1f}{reducing[0]:>7.1f}{reducing[1]:>7.1f}"
            rates = f"{1e9 * reducing[1] / n_points:>10.0f}{reducing[1] / reading[1]:>7.1f}"
            memory = f"{found['before']} {found['peak']} {found['end']}"
            print(
                f"{n_points:>11}{n_workers:>8}{seconds}{rates}{report[0]:>7.1f}{report[1]:>6.1f}{found['kept']:>9} "
                f"{found['digest']} {memory} {found['verdict']}",
                flush=True,
            )


if __name__ == "__main__":
    main()
