"""A report of a cloud without normals against Open3D's orientation and Poisson reconstruction, in one run.

python benchmarks/against_poisson.py [--sizes 10000 100000 500000] [--repeats 1]

Open3D: normals from 20 neighbors, `orient_normals_consistent_tangent_plane`, screened Poisson of depth 8, the part
below the densest 99 % cut away, V − E + F. Both take turns on the same points of a surface of genus 3 (χ = −4).
Processor seconds are those of all threads, which a busy machine changes least. Asked for: at most twice Open3D's at
10 000 points, and at most as many from 100 000 on.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
import open3d
import torch

import topokit as tk
from topokit.core.mesh.sampling import sample_triangles
from topokit.testing import genus_mesh

NEIGHBORS = 20
TANGENT_NEIGHBORS = 15
DEPTH = 8
CUT_AWAY = 0.01  # share of the vertices of least density


def poisson_euler(points: np.ndarray) -> int:
    """V − E + F of Open3D's reconstruction."""
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(NEIGHBORS))
    cloud.orient_normals_consistent_tangent_plane(TANGENT_NEIGHBORS)
    mesh, density = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=DEPTH)
    mesh.remove_vertices_by_mask(np.asarray(density) < np.quantile(density, CUT_AWAY))
    return int(mesh.euler_poincare_characteristic())


def timed(call: Callable[[], object]) -> tuple[float, float, object]:
    """Seconds, processor seconds and result."""
    started, worked = time.perf_counter(), time.process_time()
    found = call()
    return time.perf_counter() - started, time.process_time() - worked, found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="*", default=[10_000, 100_000, 500_000])
    parser.add_argument("--repeats", type=int, default=1)
    given = parser.parse_args()
    vertices, faces = (torch.as_tensor(part) for part in genus_mesh(3))
    print(
        f"{'points':>8}{'ours s':>9}{'CPU s':>8}{'χ':>5}{'Open3D s':>10}{'CPU s':>8}{'χ':>6}{'ratio':>8}{'of CPU':>8}"
    )
    for size in given.sizes:
        points = sample_triangles(vertices.double(), faces.long(), size)[0].points
        tk.from_points(points[:2000]).report()  # warm up
        for _ in range(given.repeats):
            seconds, cpu, report = timed(lambda: tk.from_points(points).report().euler)  # noqa: B023
            theirs, their_cpu, euler = timed(lambda: poisson_euler(points.numpy()))  # noqa: B023
            print(
                f"{size:>8}{seconds:>9.2f}{cpu:>8.2f}{report!s:>5}{theirs:>10.2f}{their_cpu:>8.2f}{euler!s:>6}"
                f"{seconds / theirs:>8.2f}{cpu / their_cpu:>8.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
