"""A folder of small meshes in one process and in two: seconds per file, and memory from the 100th to the last.

    python benchmarks/bench_survey.py [FILES]

Limits: two processes may take at most 0.8 × the time of one, from the first row to the last, where two cores are free
(starting them is paid once); no process may grow by more than 10 % after the first tenth of the files.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

import pytest

import topokit as tk
from topokit.core.processors import n_cores
from topokit.testing import genus_mesh, icosphere, torus_mesh

FILES = 1000


def write_files(folder: Path, count: int) -> list[Path]:
    """Binary STL files of five shapes in many sizes."""
    shapes = [*(genus_mesh(genus, resolution=10) for genus in (1, 2, 3)), icosphere(3), torus_mesh(24, 12)]
    paths = [folder / f"{number:04}.stl" for number in range(count)]
    for number, path in enumerate(paths):
        vertices, faces = shapes[number % len(shapes)]
        tk.from_mesh(vertices * (1 + number / count), faces).to_trimesh().export(path)
    return paths


def resident(pid: str) -> int:
    """Memory of a process in kB, or 0 where the system does not say."""
    status = Path(f"/proc/{pid}/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((int(line.split()[1]) for line in lines if line.startswith("VmRSS")), 0)


def measured(paths: list[Path], jobs: int) -> tuple[float, float]:
    """Seconds per file after the first tenth, and by which factor the memory grew in that time."""
    early = (0.0, 0)
    for number, row in enumerate(tk.survey(paths, jobs=jobs), 1):
        assert row["error"] is None, row["error"]
        if number == len(paths) // 10:
            early = time.perf_counter(), memory()
        if number == len(paths):
            seconds = (time.perf_counter() - early[0]) / (0.9 * len(paths))
            return seconds, memory() / max(early[1], 1)
    raise AssertionError("no rows")


def memory() -> int:
    """Of this process and of those that it started, in kB."""
    children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children")
    started = children.read_text().split() if children.exists() else []
    return sum(map(resident, ["self", *started]))


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return write_files(tmp_path_factory.mktemp("files"), FILES)


def test_memory_stays_flat(paths: list[Path]) -> None:
    for jobs in (1, 2):
        assert measured(paths, jobs)[1] < 1.1


@pytest.mark.skipif(n_cores() < 2, reason="one core cannot do two things at once")
def test_two_processes_are_faster_than_one(paths: list[Path]) -> None:
    assert measured(paths, 2)[0] < 0.8 * measured(paths, 1)[0]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        files = write_files(Path(folder), int(sys.argv[1]) if len(sys.argv) > 1 else FILES)
        for jobs in (1, 2):
            seconds, growth = measured(files, jobs)
            print(f"--jobs {jobs}: {1000 * seconds:.1f} ms per file, memory x {growth:.3f}", flush=True)
