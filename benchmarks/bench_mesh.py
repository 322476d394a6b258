"""Reading and counting meshes against trimesh: load, merge equal vertices, V − E + F, on the same files in turn.

    python benchmarks/bench_mesh.py

Limits: at most 3 × trimesh for STL, OBJ and PLY files of 10 000 to 2 000 000 faces, with shared vertices and as loose
triangles that close, and for 1 000 000 loose triangles that do not; at most 10 × for a thousand tiny STL files; time
grows with the number of faces as trimesh's does. Times are CPU seconds of the process over all threads, medians of
three.
Both sides take the same question to its integer; topokit's includes components, nesting, orientation and boundaries.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from statistics import median
from time import process_time

import numpy as np
import pytest
import trimesh

import topokit as tk
from topokit.testing import genus_mesh, icosphere, torus_mesh
from topokit.testing.meshes import Mesh

FORMATS = ("stl", "obj", "ply")
TORI = {10_000: (100, 50), 100_000: (500, 100), 500_000: (500, 500), 2_000_000: (1000, 1000)}
RUNS = 3
MOST, MOST_TINY = 3.0, 10.0
MOST_EXCESS = 0.25  # of the slope over trimesh's, which is linear but for caches and memory
N_TINY = 1000
pytestmark = pytest.mark.timeout(0)  # large files are written and read several times


def trimesh_euler(path: Path) -> int:
    mesh = trimesh.load(path, process=False)
    mesh.merge_vertices()
    return int(mesh.euler_number)


def topokit_euler(path: Path) -> int:
    euler = tk.load(path).report().euler
    assert euler is not None
    return euler


def loose(mesh: Mesh) -> Mesh:
    """The same triangles, none of which share a vertex."""
    vertices, faces = mesh
    return vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


def written(mesh: Mesh, path: Path) -> Path:
    trimesh.Trimesh(*mesh, process=False).export(path)
    return path


def random_triangles(count: int) -> Mesh:
    """Loose triangles, about two edge lengths apart."""
    generator = np.random.default_rng(0)
    size = count ** (-1 / 3)
    corners = generator.random((count, 1, 3)) + size * generator.normal(size=(count, 3, 3)) / 4
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def seconds(question: Callable[[Path], int], paths: list[Path], euler: int) -> float:
    started = process_time()
    answers = {question(path) for path in paths}
    spent = process_time() - started
    assert answers == {euler}, f"{question.__name__}: {answers}, expected {euler}"
    return spent


def compare(name: str, paths: list[Path], euler: int, limit: float) -> tuple[float, float]:
    """Ask both in turn, print their times, and return them: topokit's and trimesh's."""
    rows = [(seconds(topokit_euler, paths, euler), seconds(trimesh_euler, paths, euler)) for _ in range(RUNS)]
    ratio = median(ours / theirs for ours, theirs in rows)
    ours, theirs = (median(column) for column in zip(*rows, strict=True))
    print(f"{name:34s} topokit {ours:7.3f} s, trimesh {theirs:7.3f} s, ratio {ratio:5.2f}", flush=True)
    assert ratio <= limit, f"{name}: {ratio:.2f} × trimesh, at most {limit} was asked"
    return ours, theirs


def _slopes(spent: dict[int, float]) -> list[float]:
    """Growth of log time over log faces between neighboring sizes: 1 is linear, 2 quadratic."""
    return [float(np.log(spent[many] / spent[few]) / np.log(many / few)) for few, many in pairwise(spent)]


def _listed(slopes: list[float]) -> str:
    return ", ".join(f"{slope:.2f}" for slope in slopes)


@pytest.fixture(scope="module", autouse=True)
def _warm(tmp_path_factory: pytest.TempPathFactory) -> None:
    """What the first file of a format costs, imports above all, belongs to neither side."""
    for suffix in FORMATS:
        path = written(icosphere(1), tmp_path_factory.mktemp("warm") / f"ball.{suffix}")
        assert topokit_euler(path) == trimesh_euler(path) == 2


@pytest.fixture
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


@pytest.mark.parametrize("is_loose", [False, True], ids=["shared", "loose"])
@pytest.mark.parametrize("suffix", FORMATS)
def test_meshes_that_close(suffix: str, is_loose: bool, folder: Path) -> None:
    if suffix == "stl" and is_loose:
        pytest.skip("STL files hold loose triangles in any case")
    spent = {}
    for n_faces, (n_around, n_tube) in TORI.items():
        mesh = torus_mesh(n_around, n_tube)
        path = written(loose(mesh) if is_loose else mesh, folder / f"torus.{suffix}")
        name = f"{suffix}{', loose' if is_loose else ''}, {n_faces:,} faces"
        spent[n_faces] = compare(name, [path], 0, MOST)
    slopes, control = (_slopes({n: both[side] for n, both in spent.items()}) for side in (0, 1))
    print(f"{suffix}: slopes of log time over log faces {_listed(slopes)}; trimesh's {_listed(control)}")
    assert slopes[-1] <= control[-1] + MOST_EXCESS, f"time grows as faces to the power {slopes[-1]:.2f}"


@pytest.mark.parametrize("suffix", FORMATS)
def test_genus_and_nesting(suffix: str, folder: Path) -> None:
    (bar, bar_faces), (ball, ball_faces) = genus_mesh(6, 60), icosphere(6, 0.05)
    nested = np.concatenate((bar, ball + np.array([-1.0, 0, 0]))), np.concatenate((bar_faces, ball_faces + len(bar)))
    compare(f"{suffix}, genus 6 with a cavity", [written(nested, folder / f"bar.{suffix}")], -8, MOST)


def test_a_million_loose_triangles(folder: Path) -> None:
    path = written(random_triangles(1_000_000), folder / "soup.stl")
    compare("stl, 1,000,000 loose triangles", [path], 1_000_000, MOST)


def test_a_thousand_tiny_files(folder: Path) -> None:
    paths = [written(torus_mesh(12, 8), folder / f"{index}.stl") for index in range(N_TINY)]
    compare(f"stl, {N_TINY:,} files of 192 faces", paths, 0, MOST_TINY)


if __name__ == "__main__":
    sys.exit(pytest.main([__file__, "-s", "-q", "-p", "no:cacheprovider"]))
