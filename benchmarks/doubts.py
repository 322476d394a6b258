"""Is a wrong answer about a cloud wrong at one of its doubts?

    python benchmarks/doubts.py DATA [--scenarios points unoriented noisy] [--seed 0] [--names NAME …] [--out FILE]

Every closed mesh that DATA/index.json names is sampled by 10 000 random points. Where the report's integer is wrong,
the solid that was found is compared with the true one on a common grid. The parts, tunnels and cavities that are
missing or spurious are where the truth differs. A doubt is there if it lies within the resolution of the region in
which the solids differ. The share of the surface that lies as close to some doubt tells how much that means: where it
is half, so would be random places.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from confidence import clean_meshes
from numpy.typing import NDArray
from scale_truth import mesh_of

import topokit as tk
from topokit.comparison.result import Difference
from topokit.comparison.solids import compare_solids
from topokit.core.components import corner
from topokit.core.grid.grid import Grid
from topokit.core.mesh.rasterized import rasterized
from topokit.core.surface import TriangleSurface
from topokit.shape.surface import found_surface

Floats = NDArray[np.float64]
N_POINTS = 10_000
NOISE = 0.005  # longest sides
CELLS = 220  # of the common grid along the longest side, at most
MARGIN = (2.301, 2.3017, 2.3023)  # cells around the solids: lines along symmetry planes graze their edges


def cloud_of(mesh: trimesh.Trimesh, scenario: str, seed: int) -> tuple[Floats, Floats | None]:
    """Samples (N, 3) of a mesh and their normals (N, 3), or None."""
    points, face = trimesh.sample.sample_surface(mesh, N_POINTS, seed=seed)
    points = np.asarray(points, dtype=np.float64)
    if scenario == "noisy":
        rng = np.random.default_rng(seed)
        points = points + rng.normal(size=points.shape) * NOISE * np.ptp(points, axis=0).max()
    return points, mesh.face_normals[face] if scenario == "points" else None


def distances(boxes: Floats, places: Floats) -> Floats:
    """Distance (B, P) of every place (P, 3) from every box (B, 2, 3)."""
    beyond = np.maximum(boxes[:, None, 0] - places, places - boxes[:, None, 1])
    return np.linalg.norm(np.maximum(beyond, 0), axis=2)


def differences(found: TriangleSurface, truth: TriangleSurface, width: float) -> tuple[Difference, ...]:
    """Where two solids differ in topology, on a grid with four cells across a width if that is not too fine."""
    vertices = np.concatenate((found.vertices, truth.vertices))
    low, high = vertices.min(0), vertices.max(0)
    cell = max(width / 4, float((high - low).max()) / CELLS)
    x, y, z = (np.ceil((high - low) / cell) + 5).astype(int).tolist()
    grid = Grid((x, y, z), (cell,) * 3, corner(low - cell * np.array(MARGIN)))
    return compare_solids(rasterized(found, grid), rasterized(truth, grid), grid).features


def judged(shape: tk.Shape, truth: TriangleSurface, resolution: float) -> dict[str, Any]:
    """How many differences there are, how many of them have a doubt, and the share of the surface near a doubt."""
    found, doubts = found_surface(shape), shape.report(features=True).doubts
    if found is None or doubts is None:  # an open cloud
        return {}
    places = np.array([one.place for one in doubts]).reshape(-1, 3)
    unlike = differences(found, truth, resolution)
    boxes = np.array([one.cause or one.bounds for one in unlike]).reshape(-1, 2, 3)
    near = distances(boxes, places).min(1, initial=np.inf) <= resolution
    surface = trimesh.sample.sample_surface(trimesh.Trimesh(truth.vertices, truth.faces), 2_000, seed=0)[0]
    beside = distances(np.stack([places, places], 1), surface).min(0, initial=np.inf) <= resolution
    return {
        "doubts": len(places),
        "differences": len(boxes),
        "found": int(near.sum()),
        "surface": round(float(beside.mean()), 3),
        "kinds": sorted({one.kind for one in unlike}),
    }


def wrong_answers(folder: Path, options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A record for each."""
    for name, row in sorted(clean_meshes(folder).items()):
        if options.names and name not in options.names:
            continue
        mesh = mesh_of(folder / row["path"])
        for scenario in options.scenarios:
            points, normals = cloud_of(mesh, scenario, options.seed)
            found = None if normals is None else torch.from_numpy(normals)
            shape = tk.from_points(torch.from_numpy(points), found)
            report = shape.report()
            if report.euler == row["chi"]:
                continue
            record = {"name": name, "scenario": scenario, "verdict": report.verdict, "truth": row["chi"]}
            record |= {"euler": report.euler, "closed": report.closed}
            assert report.resolution is not None
            yield record | judged(shape, TriangleSurface(mesh.vertices, mesh.faces), report.resolution)


def main() -> None:
    """Judge, and print a line for each wrong answer and one for all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder with index.json")
    parser.add_argument("--scenarios", nargs="+", default=["points", "unoriented", "noisy"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--names", nargs="*", help="only these meshes")
    parser.add_argument("--out", type=Path, help="JSON lines")
    options = parser.parse_args()
    rows = []
    for row in wrong_answers(options.data, options):
        rows.append(row)
        print(json.dumps(row), flush=True)
        if options.out:
            with options.out.open("a") as file:
                file.write(json.dumps(row) + "\n")
    told = [row for row in rows if "found" in row and row["differences"]]
    hit = sum(row["found"] > 0 for row in told)
    print(f"{len(rows)} wrong answers; {len(told)} differ somewhere on the common grid, {hit} of them at a doubt")


if __name__ == "__main__":
    main()
