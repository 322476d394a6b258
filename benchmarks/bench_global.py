"""The global half against its floors: ratios within one run.

    python -m pytest benchmarks/bench_global.py -s    also --device cuda

Asked for: χ of 10 000 oriented points at most 20 × one real Fourier transform of the same grid; orientation of 10 000
points below 2 × Open3D's tangent-plane orientation and Poisson reconstruction; the smoothed χ of a 64³ field forward
and backward at least 20 × faster than one cubical persistence of gudhi; a million points below 6 GiB.
"""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from statistics import median

import numpy as np
import pytest
import torch

from benchmarks.timing import seconds
from topokit.core.cloud.witness import Witness, global_witness
from topokit.core.grid.euler import smoothed_euler, solid_euler
from topokit.core.grid.grid import make_grid
from topokit.core.grid.winding_field import winding_field
from topokit.testing import torus_samples

N_POINTS = 10_000


def alternating(repeats: int, device: torch.device, *calls: Callable[[], object]) -> list[list[float]]:
    """Seconds per repeat and call, in turn, so that a slow moment of the machine hits all calls; one warm-up."""
    return [[seconds(call, device) for call in calls] for _ in range(repeats + 1)][1:]


def smooth_field(n: int) -> torch.Tensor:
    """A field with some hundred critical points near the level, like that of a network in training."""
    coarse = torch.randn(1, 1, n // 8, n // 8, n // 8, generator=torch.Generator().manual_seed(0))
    return torch.nn.functional.interpolate(coarse, size=(n, n, n), mode="trilinear")[0, 0].contiguous()


def test_euler_of_oriented_points_over_one_fourier_transform(device: torch.device) -> None:
    known = torus_samples(N_POINTS)
    points, normals = known.points.float().to(device), known.normals.float().to(device)
    areas = torch.full((N_POINTS,), known.area / N_POINTS, device=device)
    grid = make_grid(points, math.sqrt(known.area / N_POINTS), 2.0, 128**3)
    values = torch.randn(grid.shape, device=device)
    found = []
    with torch.no_grad():
        rows = alternating(
            15,
            device,
            lambda: torch.fft.rfftn(values),
            lambda: found.append(
                2 * int(solid_euler(winding_field(points, normals, areas, grid).values, 0.5, connectivity=6))
            ),
        )
    ratio, transform = median(ours / floor for floor, ours in rows), median(floor for floor, _ in rows)
    print(f"\nχ = {found[-1]} of {N_POINTS} points on {grid.shape}: {ratio:.1f} × rfftn ({transform * 1e3:.1f} ms)")
    assert found[-1] == known.euler


def test_orientation_over_open3d() -> None:
    open3d = pytest.importorskip("open3d")
    known = torus_samples(N_POINTS)
    points, found = known.points.numpy(), list[Witness]()

    def theirs() -> None:
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
        cloud.estimate_normals()
        cloud.orient_normals_consistent_tangent_plane(16)
        open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=8)

    rows = alternating(5, torch.device("cpu"), theirs, lambda: found.append(global_witness(known.points)))
    pairs = [(row[0], witness.seconds["orientation"]) for row, witness in zip(rows, found[1:], strict=True)]
    ratio = median(ours / other for other, ours in pairs)
    right = ((found[-1].normals * known.normals.numpy()).sum(1) > 0).mean()
    times = ", ".join(f"{median(pair[k] for pair in pairs):.2f} s" for k in (0, 1))
    print(f"\norientation of {N_POINTS} points: {ratio:.2f} × Open3D ({times}); {right:.2%} of the signs right")


@pytest.mark.parametrize("connectivity", [6, 26])
@pytest.mark.parametrize("kind", ["smooth", "noise"])
def test_smoothed_euler_over_gudhi(kind: str, connectivity: int, device: torch.device) -> None:
    gudhi = pytest.importorskip("gudhi")
    field = smooth_field(64) if kind == "smooth" else torch.randn(64, 64, 64)
    leaf = field.to(device, copy=True).requires_grad_()
    values = {{6: "vertices", 26: "top_dimensional_cells"}[connectivity]: (-field).double().numpy()}

    def ours() -> None:
        leaf.grad = None
        smoothed_euler(leaf, 0.1, 0.0, connectivity).backward()

    rows = alternating(3, device, ours, lambda: gudhi.CubicalComplex(**values).compute_persistence())
    ratio = median(theirs_ / ours_ for ours_, theirs_ in rows)
    print(
        f"\nχ_τ of 64³ ({kind}, {connectivity}) forward and backward {median(r[0] for r in rows) * 1e3:.0f} ms: "
        f"{ratio:.0f} × faster than gudhi"
    )


@pytest.mark.parametrize(
    "call", ["global_witness(points)", "global_witness(points, normals)", "field(points, normals)"]
)
def test_memory_of_a_million_points(call: str) -> None:
    script = (
        "import resource, time, torch\n"
        "from benchmarks.bench_global import field_euler as field\n"
        "from topokit.core.cloud.witness import global_witness\n"
        "from topokit.testing import torus_samples\n"
        "known = torus_samples(1_000_000)\n"
        "points, normals = known.points, known.normals\n"
        f"start = time.perf_counter(); found = {call}; seconds = time.perf_counter() - start\n"
        "print(getattr(found, 'euler', found), seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    value, seconds, peak = found.stdout.split()
    unit = 1 if sys.platform == "darwin" else 1024
    print(
        f"\na million points, {call}: χ = {value}, {float(seconds):.0f} s, {int(peak) * unit / 2**30:.2f} GiB at most"
    )


def field_euler(points: torch.Tensor, normals: torch.Tensor) -> int:
    """χ of the surface by one winding-number field of 192³ vertices."""
    areas = torch.ones(len(points), dtype=points.dtype)
    spacing = float(np.ptp(points.numpy(), axis=0).max()) / 100
    with torch.no_grad():
        field = winding_field(points, normals, areas / len(points), make_grid(points, spacing))
        return 2 * int(solid_euler(field.values, 0.5, connectivity=6))


if __name__ == "__main__":
    sys.exit(pytest.main([__file__, "-s"]))
