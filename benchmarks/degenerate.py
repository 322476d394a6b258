"""Points that bound no solid, or hardly one: what a report costs and says.

python benchmarks/degenerate.py [--points 200000] [--only KIND ...]

Each kind runs in a process of its own, which is ended after a minute of processor time. Every kind must end within ten
processor seconds, and must not be called "likely" unless its points lie on a closed surface.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MOST_SECONDS = 10  # processor seconds that each kind may take
GIVEN_UP = 60  # processor seconds after which a kind is ended


def gaussian_blob(rng: np.random.Generator, count: int) -> Floats:
    """Noise without a surface."""
    return rng.normal(size=(count, 3))


def uniform_blob(rng: np.random.Generator, count: int) -> Floats:
    """A cube full of points."""
    return rng.random((count, 3))


def blob_of_two_scales(rng: np.random.Generator, count: int) -> Floats:
    """A dense blob in a thin one."""
    return np.concatenate((rng.normal(size=(count // 2, 3)), 0.01 * rng.normal(size=(count - count // 2, 3))))


def lattice(rng: np.random.Generator, count: int) -> Floats:
    """The points of a cubic lattice."""
    side = np.arange(round(count ** (1 / 3)), dtype=np.float64)
    return np.stack(np.meshgrid(side, side, side), -1).reshape(-1, 3)


def lattice_surface(rng: np.random.Generator, count: int) -> Floats:
    """The points of a cubic lattice on the faces of a cube."""
    n = round((count / 6) ** 0.5) + 1
    index = np.stack(np.meshgrid(*[np.arange(n)] * 2), -1).reshape(-1, 2)
    faces = [np.insert(index, axis, end, axis=1) for axis in range(3) for end in (0, n - 1)]
    return np.unique(np.concatenate(faces), axis=0).astype(np.float64)


def plane(rng: np.random.Generator, count: int) -> Floats:
    """Points in a tilted plane."""
    return rng.random((count, 2)) @ np.array([[1.0, 0.2, 0.3], [0.1, 1.0, -0.4]])


def thick_plane(rng: np.random.Generator, count: int) -> Floats:
    """A square with noise."""
    return np.column_stack((rng.random((count, 2)), 0.01 * rng.normal(size=count)))


def plane_lattice(rng: np.random.Generator, count: int) -> Floats:
    """A square lattice with one point off its plane."""
    side = np.arange(round(count**0.5), dtype=np.float64)
    points = np.stack(np.meshgrid(side, side, [0.0]), -1).reshape(-1, 3)
    points[0, 2] = 1.0
    return points


def line(rng: np.random.Generator, count: int) -> Floats:
    """Points on a line."""
    return rng.random((count, 1)) * np.array([[1.0, 2.0, 3.0]])


def thick_line(rng: np.random.Generator, count: int) -> Floats:
    """A line with noise in all directions."""
    return np.column_stack((np.linspace(0, 1, count), 1e-4 * rng.normal(size=(count, 2))))


def curve(rng: np.random.Generator, count: int) -> Floats:
    """A helix."""
    angle = np.linspace(0, 20 * np.pi, count)
    return np.column_stack((np.cos(angle), np.sin(angle), angle / 20))


def thirty_three_points(rng: np.random.Generator, count: int) -> Floats:
    """As few points as a report takes, and one."""
    return sphere(rng, 33)


def few_places(rng: np.random.Generator, count: int) -> Floats:
    """A hundred places, each many times."""
    return rng.normal(size=(100, 3))[rng.integers(0, 100, count)]


def every_point_ten_times(rng: np.random.Generator, count: int) -> Floats:
    """A sphere whose points occur ten times each."""
    return np.repeat(sphere(rng, count // 10), 10, axis=0)


def outlier(rng: np.random.Generator, count: int) -> Floats:
    """A sphere and one point a million radii away."""
    return np.concatenate((sphere(rng, count - 1), [[1e6, 0.0, 0.0]]))


def outliers_everywhere(rng: np.random.Generator, count: int) -> Floats:
    """A sphere among as many points of a cube."""
    return np.concatenate((sphere(rng, count // 2), 4 * rng.random((count - count // 2, 3)) - 2))


def far_pair(rng: np.random.Generator, count: int) -> Floats:
    """Two spheres a million radii apart."""
    return np.concatenate((sphere(rng, count // 2), sphere(rng, count // 2) + np.array([1e6, 0.0, 0.0])))


def noisy_sphere(rng: np.random.Generator, count: int) -> Floats:
    """A sphere with noise of a tenth of its radius."""
    return sphere(rng, count) * rng.normal(1, 0.1, (count, 1))


def nested_spheres(rng: np.random.Generator, count: int) -> Floats:
    """Eighty spheres in each other."""
    return sphere(rng, count) * rng.integers(20, 100, (count, 1)) / 100


def sphere(rng: np.random.Generator, count: int) -> Floats:
    """Points on a sphere."""
    points = rng.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


KINDS: dict[str, Callable[[np.random.Generator, int], Floats]] = {
    one.__name__: one
    for one in (
        gaussian_blob,
        uniform_blob,
        blob_of_two_scales,
        lattice,
        lattice_surface,
        plane,
        thick_plane,
        plane_lattice,
        line,
        thick_line,
        curve,
        thirty_three_points,
        few_places,
        every_point_ten_times,
        outlier,
        outliers_everywhere,
        far_pair,
        noisy_sphere,
        nested_spheres,
    )
}
CLOSED = {
    "lattice_surface": 2,
    "thick_line": 2,  # the surface of a rod
    "curve": 2,
    "every_point_ten_times": 2,
    "outlier": 2,
    "outliers_everywhere": 2,
    "far_pair": 4,
    "noisy_sphere": 2,
}
"""The Euler characteristic of the kinds whose points lie on a closed surface, or around a curve."""


def measure(kind: str, count: int) -> dict[str, object]:
    """One report: what it says and the processor seconds it took."""
    import topokit as tk

    points = KINDS[kind](np.random.default_rng(0), count)
    before = resource.getrusage(resource.RUSAGE_SELF)
    try:
        report = tk.from_points(points).report()
        found = {"verdict": report.verdict, "euler": report.euler, "reason": report.reasons[0]}
    except tk.TopokitError as error:
        found = {"verdict": "error", "euler": None, "reason": str(error)}
    after = resource.getrusage(resource.RUSAGE_SELF)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {**found, "seconds": seconds, "points": len(points)}


def asked(kind: str, count: int) -> dict[str, object]:
    """The same in a process of its own with limited processor time."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (GIVEN_UP, GIVEN_UP))

    command = [sys.executable, __file__, "--points", str(count), "--measure", kind]
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=limit)
    if done.returncode == 0:
        return dict(json.loads(done.stdout))
    reason = (done.stderr.strip().splitlines() or ["ended by the limit"])[-1]
    return {"verdict": "ended", "euler": None, "reason": reason, "seconds": float(GIVEN_UP), "points": count}


def main() -> int:
    """Print the table; the exit status says whether all kinds are within the limits."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=200_000)
    parser.add_argument("--only", nargs="*", choices=KINDS, default=list(KINDS))
    parser.add_argument("--measure", help="measure one kind and print JSON")
    given = parser.parse_args()
    if given.measure:
        print(json.dumps(measure(given.measure, given.points)))
        return 0
    print(f"{'kind':<24}{'CPU s':>7}  {'verdict':<8}{'χ':>7}  first reason")
    is_bad = False
    for kind in given.only:
        row = asked(kind, given.points)
        is_wrong = row["verdict"] in ("likely", "certain") and row["euler"] != CLOSED.get(kind)
        is_bad |= is_wrong or row["verdict"] == "ended" or float(str(row["seconds"])) > MOST_SECONDS
        print(f"{kind:<24}{row['seconds']:>7.1f}  {row['verdict']:<8}{row['euler']!s:>7}  {row['reason']}", flush=True)
    return int(is_bad)


if __name__ == "__main__":
    sys.exit(main())
