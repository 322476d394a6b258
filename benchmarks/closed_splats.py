"""Spheres, tori and knots as splats of random numbers, sizes, overlaps, jitters and opacities: is the genus found?

    python benchmarks/closed_splats.py --settings 200 --out closed.jsonl

A setting is drawn again if its narrowest part or tunnel is narrower than three spacings, √(area / number of splats):
such features are no claim of a report. `--out` is continued if it exists.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from splat_scenes import Style, discs_on

import topokit as tk
from topokit.testing import icosphere, torus_knot, torus_mesh

FEWEST, MOST = 200, 100_000  # splats
RESOLVED = 3.0  # spacings of the narrowest feature


def drawn(number: int) -> tuple[str, trimesh.Trimesh, int, int, Style, np.random.Generator]:
    """The name of a setting's shape, the shape, its χ, the number of splats and how they lie."""
    rng = np.random.default_rng(number)
    while True:
        count = round(float(np.exp(rng.uniform(np.log(FEWEST), np.log(MOST)))))
        name = str(rng.choice(["sphere", "torus", "knot"]))
        mesh, width = _shape(name, rng)
        if width >= RESOLVED * np.sqrt(mesh.area / count):
            break
    style = Style(
        overlap=float(rng.uniform(0.4, 2.0)),
        spread=float(rng.uniform(1.0, 2.0)),
        jitter=float(rng.uniform(0.0, 0.1)),
        faintest=float(rng.uniform(0.2, 0.9)),
        even=bool(rng.random() < 0.5),
    )
    return name, mesh, 2 if name == "sphere" else 0, count, style, rng


def _shape(name: str, rng: np.random.Generator) -> tuple[trimesh.Trimesh, float]:
    """A mesh and the width of its narrowest part or tunnel."""
    if name == "sphere":
        return trimesh.Trimesh(*icosphere(5), process=False), 2.0
    if name == "torus":
        minor = float(rng.uniform(0.15, 0.6))
        return trimesh.Trimesh(*torus_mesh(256, 128, minor=minor), process=False), 2 * min(minor, 1 - minor)
    radius = float(rng.uniform(0.1, 0.3))
    width = min(2 * radius, 1 - 2 * radius)  # strands are a unit apart
    return trimesh.Trimesh(*torus_knot(2, 3, radius=radius), process=False), width


def measured(number: int) -> dict[str, Any]:
    """What the report of one setting says."""
    name, mesh, euler, count, style, rng = drawn(number)
    splats = discs_on(mesh, count, style, rng)
    started = time.perf_counter()
    report = tk.from_splats(splats).report()
    return {
        "number": number,
        "shape": name,
        "splats": len(splats),
        **vars(style),
        "euler": report.euler,
        "right": report.euler == euler and report.closed,
        "likely": report.verdict == "likely",
        "why": report.reasons[0],
        "seconds": time.perf_counter() - started,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--settings", type=int, default=200)
    parser.add_argument("--out", type=Path, default=Path("closed.jsonl"))
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    with options.out.open("a") as file:
        for number in range(len(rows), options.settings):
            rows.append(measured(number))
            file.write(json.dumps(rows[-1]) + "\n")
            file.flush()
    likely = [row for row in rows if row["likely"]]
    print(
        f"{len(rows)} settings: right {sum(row['right'] for row in rows)}, likely {len(likely)}, "
        f"wrong likely {sum(not row['right'] for row in likely)}"
    )


if __name__ == "__main__":
    main()
