"""Closed meshes as splats on a table in a room: is the object found, and its genus?

    python benchmarks/splat_rooms.py DATA --shapes 40 --out rooms.jsonl
    python benchmarks/splat_rooms.py DATA --shapes 1 --splats 93000 --out large.jsonl    # a million in the largest room

DATA holds index.json and the closed meshes that it names. Each stands on a table in three rooms: alone; before a wall,
with more haze and floaters; in the corner of two walls, turned by a random rotation. What faces down near the table is
missing, as in a capture from above. Found is the intersection over union of the splats kept and those of the mesh.
`--out` is continued if it exists.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from confidence import clean_meshes, read_rows
from numpy.typing import NDArray
from scale_truth import mesh_of
from scipy.spatial.transform import Rotation
from splat_scenes import Style, splats_at

import topokit as tk

Floats = NDArray[np.float64]

SPLATS = 6_000  # of an object, unless another number is asked for
DOWN = -0.5  # height of the normals of what is missing near the table
NEAR = 0.1  # of the object's height
COARSE = 2.5  # spacing of the splats of tables and walls over that of the object
STYLE = Style(overlap=0.7, spread=1.5, jitter=0.05, faintest=0.4)


def room(
    mesh: trimesh.Trimesh, kind: int, rng: np.random.Generator, count: int = SPLATS
) -> tuple[tk.GaussianSplats, int]:
    """A scene whose first splats are those of the object, and how many these are."""
    places, face = trimesh.sample.sample_surface(mesh, count, seed=int(rng.integers(1 << 31)))
    places, normals = np.asarray(places), mesh.face_normals[face]
    extent = float(np.ptp(places, axis=0).max())
    places = (places - places.mean(0)) / extent
    places[:, 2] -= places[:, 2].min()
    spacing = float(np.sqrt(mesh.area / count)) / extent
    hidden = (normals[:, 2] < DOWN) & (places[:, 2] < NEAR * np.ptp(places[:, 2]))
    parts = [splats_at(places[~hidden], normals[~hidden], spacing, STYLE, rng)]
    n_object = len(parts[0])
    parts.append(_square(rng, (0, 1), np.array([0.0, 0.0, -0.5 * spacing]), 2.0, spacing))
    for axis in range(kind):
        parts.append(_square(rng, (1 - axis, 2), np.where(np.arange(3) == axis, -1.5, [0, 0, 2.0]), 2.0, spacing))
    for _ in range(3 + 4 * kind):  # floaters
        center, count = rng.uniform([-1.4, -1.4, 0.3], [1.4, 1.4, 2.0]), int(rng.integers(3, 20))
        parts.append(_cloud(rng, center, 0.03, count, spacing, (0.3, 0.9)))
    parts.append(_cloud(rng, np.array([0, 0, 1.0]), 0.7, count * (1 + kind) // 20, 2 * spacing, (0.02, 0.15)))
    turn = Rotation.random(rng=rng) if kind == 2 else Rotation.identity()
    names = ("means", "scales", "quaternions", "opacities")
    columns = [torch.cat([getattr(part, name) for part in parts]) for name in names]
    columns[0] = torch.from_numpy(turn.apply(columns[0].numpy()))
    spun = turn * Rotation.from_quat(columns[2].numpy()[:, [1, 2, 3, 0]])
    columns[2] = torch.from_numpy(spun.as_quat()[:, [3, 0, 1, 2]])
    return tk.GaussianSplats(*columns), n_object


def _square(
    rng: np.random.Generator, axes: tuple[int, int], center: Floats, half: float, spacing: float
) -> tk.GaussianSplats:
    count = round((2 * half / (COARSE * spacing)) ** 2)
    places = np.tile(center, (count, 1))
    places[:, axes] += rng.uniform(-half, half, (count, 2))
    normal = np.zeros((count, 3))
    normal[:, 3 - sum(axes)] = 1
    return splats_at(places, normal, COARSE * spacing, STYLE, rng)


def _cloud(
    rng: np.random.Generator, center: Floats, width: float, count: int, spacing: float, opacity: tuple[float, float]
) -> tk.GaussianSplats:
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    splats = splats_at(center + width * rng.normal(size=(count, 3)), normals, spacing, STYLE, rng)
    opacities = torch.from_numpy(rng.uniform(*opacity, count))
    return tk.GaussianSplats(splats.means, splats.scales, splats.quaternions, opacities)


def measured(data: Path, row: dict[str, Any], kind: int, count: int) -> dict[str, Any]:
    """What is found in one room, and what the report says."""
    mesh = mesh_of(data / row["path"])
    scene, n_object = room(mesh, kind, np.random.default_rng([len(row["name"]), row["chi"] % 1000, kind]), count)
    started = time.process_time()
    kept = scene.object()
    n_right = int((kept.rows < n_object).sum())
    found = time.process_time()
    try:
        report = tk.from_splats(scene, object=True).report()
        said = {"genus": report.genus, "rims": report.rim_widths, "verdict": report.verdict}
    except tk.TopokitError as error:
        said = {"genus": None, "rims": (), "verdict": str(error)}
    return {
        "name": row["name"],
        "room": kind,
        "iou": n_right / (len(kept) + n_object - n_right),
        "planes": len(kept.planes),
        "truth": row["genus"],
        **said,
        "splats": len(scene),
        "seconds": [found - started, time.process_time() - found],
        "gib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--shapes", type=int, default=40)
    parser.add_argument("--splats", type=int, default=SPLATS, help="of the object")
    parser.add_argument("--out", type=Path, default=Path("rooms.jsonl"))
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = read_rows(options.out) if options.out.exists() else []
    done = {(row["name"], row["room"]) for row in rows}
    shapes = list(clean_meshes(options.data).values())
    with options.out.open("a") as file:
        for row in shapes[: options.shapes]:
            for kind in range(3):
                if (row["name"], kind) not in done:
                    rows.append(measured(options.data, row, kind, options.splats))
                    file.write(json.dumps(rows[-1]) + "\n")
                    file.flush()
    right = [row["genus"] == row["truth"] for row in rows]
    sure = [is_right for row, is_right in zip(rows, right, strict=True) if row["verdict"] == "likely"]
    print(
        f"{len(rows)} rooms: median intersection over union {np.median([row['iou'] for row in rows]):.3f}, genus right "
        f"{sum(right)}, likely {len(sure)}, wrong likely {len(sure) - sum(sure)}"
    )
    print(
        f"at most {max(row['splats'] for row in rows)} splats, {max(sum(row['seconds']) for row in rows):.0f} CPU s, "
        f"{max(row['gib'] for row in rows):.1f} GiB"
    )


if __name__ == "__main__":
    main()
