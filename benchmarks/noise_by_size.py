"""Do more points of a noisy surface ever give a worse answer?

    python benchmarks/noise_by_size.py --out noise.jsonl [--meshes DATA] [--every 4]

Shapes: the twelve smooth ones of `smooth_shapes.py`, random solids, and, with `--meshes`, closed meshes of a folder
with an index.json. One draw of 200 000 random points of each gets noise of a share of the longest side; the clouds of
10 000 and 60 000 points are its first points, without normals. `--out` is continued if it exists. An answer is right at
its resolution if it is that of the solid without the features narrower than `report().resolution`.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from confidence import clean_meshes, read_rows
from random_solids import random_solid
from scale_truth import mesh_of, right_at_scale
from smooth_shapes import smooth_meshes

import topokit as tk

SIZES, NOISES = (10_000, 60_000, 200_000), (0.005, 0.01, 0.02)
FIRST_SOLID, N_SOLIDS = 5_000, 6  # seeds that no calibration used


def shapes(folder: Path | None, every: int) -> Iterator[tuple[str, str, trimesh.Trimesh]]:
    """Family, name and closed mesh of each shape."""
    for name, mesh in smooth_meshes().items():
        yield "smooth", name, trimesh.Trimesh(*mesh, process=False)
    for seed in range(FIRST_SOLID, FIRST_SOLID + N_SOLIDS):
        yield "solid", f"solid {seed}", random_solid(seed)
    rows = clean_meshes(folder) if folder else {}
    for name in sorted(rows)[::every]:
        assert folder is not None
        yield "real", name, mesh_of(folder / rows[name]["path"])


def answer(mesh: trimesh.Trimesh, points: np.ndarray, noise: float) -> dict[str, Any]:
    """What the report says of a cloud, and whether it is right."""
    started = time.process_time()
    found = tk.from_points(torch.from_numpy(points)).report()
    seconds = round(time.process_time() - started, 1)
    known = found.euler is not None and found.resolution is not None
    return {
        "n": len(points),
        "noise": noise,
        "truth": int(mesh.euler_number),
        "euler": found.euler,
        "right": found.euler == mesh.euler_number,
        "right_at_resolution": known and right_at_scale(mesh, found.euler, found.resolution),
        "likely": found.verdict == "likely",
        "confidence": found.confidence,
        "resolution": found.resolution,
        "closed": found.closed,
        "seconds": seconds,
    }


def collect(options: argparse.Namespace) -> None:
    """Add the answers that the file lacks."""
    known = (
        {(row["shape"], row["noise"], row["n"]) for row in read_rows(options.out)} if options.out.exists() else set()
    )
    with options.out.open("a") as file:
        for family, name, mesh in shapes(options.meshes, options.every):
            clean, _ = trimesh.sample.sample_surface(mesh, SIZES[-1], seed=7)
            clean = np.random.default_rng(7).permutation(np.asarray(clean, dtype=np.float64))
            jitter = np.random.default_rng(8).normal(size=clean.shape) * np.ptp(clean, axis=0).max()
            for noise in NOISES:
                for n_points in SIZES:
                    if (name, noise, n_points) not in known:
                        row = answer(mesh, (clean + noise * jitter)[:n_points], noise)
                        file.write(json.dumps({"family": family, "shape": name, **row}) + "\n")
                        file.flush()


def print_table(rows: list[dict[str, Any]]) -> None:
    """Right answers by noise, family and number of points, and the shapes of which more points lost a right one."""
    print(
        "| noise | shapes | points | right | right at the resolution | likely | of these wrong at it | CPU s, median |"
    )
    print("|---" * 8 + "|")
    for noise in NOISES:
        for family in dict.fromkeys(row["family"] for row in rows):
            for n in SIZES:
                own = [row for row in rows if (row["noise"], row["family"], row["n"]) == (noise, family, n)]
                likely = [row for row in own if row["likely"]]
                wrong = sum(not row["right_at_resolution"] for row in likely)
                right, at_scale = (sum(row[key] for row in own) for key in ("right", "right_at_resolution"))
                seconds = np.median([row["seconds"] for row in own]) if own else np.nan
                counts = f"{right} / {len(own)} | {at_scale} | {len(likely)} | {wrong}"
                print(f"| {noise:.1%} | {family} | {n} | {counts} | {seconds:.1f} |")
    known = {(row["shape"], row["noise"], row["n"]): row for row in rows}
    for (name, noise, n), row in known.items():
        for more in (size for size in SIZES if size > n):
            after = known.get((name, noise, more))
            if row["right"] and after is not None and not after["right"]:
                print(f"{name}, noise {noise:.1%}: {row['euler']} with {n} points, {after['euler']} with {more}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--meshes", type=Path)
    parser.add_argument("--every", type=int, default=4)
    options = parser.parse_args()
    collect(options)
    print_table(read_rows(options.out))


if __name__ == "__main__":
    main()
