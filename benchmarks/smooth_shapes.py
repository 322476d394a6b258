"""How often reports of points without normals are right on twelve smooth shapes, by number of points and noise.

    python benchmarks/smooth_shapes.py --seeds 10

The points are independent and uniform; noise is a share of the longest side of the bounding box. Goal: at least 97 %
right up to 0.5 % noise, at least 90 % at 1 %.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

import topokit as tk
from topokit.core.mesh.sampling import sample_triangles
from topokit.core.mesh.topology import mesh_topology
from topokit.testing import genus_mesh
from topokit.testing.meshes import Mesh

Floats = NDArray[np.float64]
NOISE = (0.0, 0.0025, 0.005, 0.01)


def ball(x: Floats, center: float = 0.0, radius: float = 1.0) -> Floats:
    return np.linalg.norm(x - np.array([center, 0, 0]), axis=-1) - radius


def ring(x: Floats, center: float = 0.0, radius: float = 1.0, tube: float = 0.35, axis: int = 2) -> Floats:
    moved = x - np.array([center, 0, 0])
    flat = [other for other in range(3) if other != axis]
    return np.hypot(np.hypot(moved[..., flat[0]], moved[..., flat[1]]) - radius, moved[..., axis]) - tube


def knot(x: Floats, p: int, q: int) -> Floats:
    t = np.linspace(0, 2 * np.pi, 1500)
    around = 2 + 0.8 * np.cos(q * t)
    curve = np.stack((around * np.cos(p * t), around * np.sin(p * t), 0.8 * np.sin(q * t)), axis=1)
    return cKDTree(curve).query(x)[0] - 0.29


FIELDS: dict[str, tuple[Callable[[Floats], Floats], float]] = {
    "sphere": (ball, 1.3),
    "torus": (ring, 1.6),
    "trefoil": (lambda x: knot(x, 2, 3), 3.4),
    "knot (2, 5)": (lambda x: knot(x, 2, 5), 3.4),
    "two linked tori": (lambda x: np.minimum(ring(x, -0.5, tube=0.25), ring(x, 0.5, tube=0.25, axis=1)), 2.0),
    "sphere in a sphere": (lambda x: np.maximum(ball(x), -ball(x, radius=0.6)), 1.3),
    "three parts": (lambda x: np.minimum(np.minimum(ball(x, -2.2, 0.8), ring(x, 0, 0.8, 0.3)), ball(x, 2.2, 0.8)), 3.3),
}


def level_set(field: Callable[[Floats], Floats], half: float, steps: int = 140) -> Mesh:
    ticks = np.linspace(-half, half, steps) + 1e-3
    grid = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1)
    values = field(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    vertices, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="descent")
    return vertices.astype(np.float64) * 2 * half / (steps - 1), faces.astype(np.int64)


def smooth_meshes() -> dict[str, Mesh]:
    """The twelve shapes by name."""
    meshes = {name: level_set(*recipe) for name, recipe in FIELDS.items()}
    return meshes | {f"genus {genus}": genus_mesh(genus) for genus in range(2, 7)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--points", type=int, nargs="+", default=[5_000, 10_000])
    options = parser.parse_args()
    meshes = smooth_meshes()
    print("| points | noise | right | likely | wrong likely | median s | wrong |")
    print("|---" * 7 + "|")
    for n_points in options.points:
        for noise in NOISE:
            right, likely, wrong_likely, seconds, wrong = 0, 0, 0, [], []
            for name, (vertices, faces) in meshes.items():
                truth = mesh_topology(vertices, faces).euler
                for seed in range(options.first, options.first + options.seeds):
                    generator = torch.Generator().manual_seed(seed)
                    # many ordered shares, a few drawn from them: independent points
                    pool, _ = sample_triangles(torch.from_numpy(vertices), torch.from_numpy(faces), 200_000, generator)
                    points = pool.points[torch.randint(200_000, (n_points,), generator=generator)]
                    size = float((points.amax(0) - points.amin(0)).max())
                    jitter = torch.randn(points.shape, generator=generator, dtype=points.dtype)
                    started = time.perf_counter()
                    found = tk.from_points(points + noise * size * jitter).report()
                    seconds.append(time.perf_counter() - started)
                    right += found.euler == truth
                    likely += found.verdict == "likely"
                    wrong_likely += found.verdict == "likely" and found.euler != truth
                    wrong += [f"{name} {found.euler} for {truth}"] if found.euler != truth else []
            counts = f"{right} / {len(meshes) * options.seeds} | {likely} | {wrong_likely}"
            print(
                f"| {n_points} | {noise:.2%} | {counts} | {np.median(seconds):.1f} | {'; '.join(wrong)} |", flush=True
            )


if __name__ == "__main__":
    main()
