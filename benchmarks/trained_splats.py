"""Splats trained on views of closed meshes: is the genus of the mesh found?

    python benchmarks/trained_splats.py DATA --scenes scenes --out trained.jsonl

DATA holds index.json and the closed meshes that it names. Each shape is seen from all around ("free"), and from above,
on a table ("table"). Splats start at random places and are optimized until the views match (`splatter.py`). They are
written to the folder `--scenes` as 3DGS PLY files, which are read again if they exist; `--out` is continued. The peak
signal-to-noise ratio is that of views that were not trained on. Needs open3d.
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
from confidence import clean_meshes, read_rows
from scale_truth import mesh_of
from splatter import as_scene, cameras, optimized, peak_ratio, photograph

import topokit as tk
from topokit.testing import genus_mesh, icosphere, linked_tori_mesh, torus_knot, torus_mesh

OWN = {
    "sphere": (icosphere(4), 0),
    "torus": (torus_mesh(96, 48), 1),
    "thin torus": (torus_mesh(96, 48, minor=0.2), 1),
    "linked tori": (linked_tori_mesh(96, 48), 2),
    "knot": (torus_knot(2, 3, radius=0.3), 1),
    "genus 2": (genus_mesh(2), 2),
    "genus 3": (genus_mesh(3), 3),
}
REAL = (
    "common3d_spot",
    "paper_Kitten",
    "paper_Genus2",
    "libigl_3holes",
    "directional_fertility",
)
OTHERS = (
    "cgal_bear",
    "cgal_knot1",
    "cgal_knot2",
    "cgal_hand",
    "gdp_double-torus",
    "trimesh_torus",
    "debmisc_gmsh_lever",
    "libigl_decimated-max",
    "cgal_joint",
    "cgal_pinion",
    "cgal_couplingdown",
    "cgal_P",
    "cgal_armadillo",
    "odedstein_goathead",
    "debmisc_gmsh_t13_data",
    "paper_Genus6",
)
SPLATS = {"free": 2_000, "table": 3_000}
LOWEST = {"free": -0.97, "table": 0.2}  # sine of the elevation of the lowest camera
VIEWS, CHECKS = 40, 8  # views to train on, and others
STEPS = 1_000
TABLE = 0.9  # half its side, in extents of the shape


def shapes(data: Path, *, others: bool = False) -> dict[str, tuple[trimesh.Trimesh, int]]:
    """Closed meshes around the origin, of extent one, with their genus, the sum over components."""
    rows = clean_meshes(data)
    own = {} if others else OWN
    found = {name: (trimesh.Trimesh(*mesh, process=False), genus) for name, (mesh, genus) in own.items()}
    for name in OTHERS if others else REAL:
        found[name] = mesh_of(data / rows[name]["path"]), rows[name]["genus"]
    for mesh, _ in found.values():
        mesh.apply_translation(-mesh.bounds.mean(0))
        mesh.apply_scale(1 / mesh.extents.max())
    return found


def trained(mesh: trimesh.Trimesh, setting: str, path: Path) -> dict[str, float]:
    """Train a scene, write it, and tell how well it shows views that it was not trained on."""
    started = time.process_time()
    if setting == "table":
        height = float(mesh.bounds[0, 2])
        corners = TABLE * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) + [0, 0, height]
        mesh = trimesh.util.concatenate([mesh, trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)])
    seen_from, others = cameras(VIEWS, lowest=LOWEST[setting]), cameras(CHECKS, lowest=LOWEST[setting], turn=1.0)
    views = [photograph(mesh, camera) for camera in seen_from]
    splats = optimized(views, seen_from, SPLATS[setting], STEPS, 0)
    as_scene(splats).to_ply(path)
    ratio = peak_ratio([photograph(mesh, camera) for camera in others], others, splats)
    return {"psnr": ratio, "training": time.process_time() - started}


def answered(path: Path, setting: str) -> dict[str, Any]:
    """What the report of a scene says, and what `genus()` answers."""
    started = time.process_time()
    shape = tk.from_splats(path, object=setting == "table")
    try:
        report = shape.report()
        said = {"verdict": report.verdict, "closed": report.closed, "euler": report.euler, "rims": report.rim_widths}
        said["genus"] = int(shape.genus())
    except tk.TopokitError as error:
        said = {"verdict": "error", "genus": None, "why": str(error)}
    return {**said, "seconds": time.process_time() - started}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--scenes", type=Path, default=Path("scenes"))
    parser.add_argument("--others", action="store_true", help="other meshes, seen from all around")
    parser.add_argument("--out", type=Path, default=Path("trained.jsonl"))
    options = parser.parse_args()
    torch.set_num_threads(1)
    options.scenes.mkdir(exist_ok=True)
    ratios = options.scenes / "ratios.json"
    known = json.loads(ratios.read_text()) if ratios.exists() else {}
    rows = read_rows(options.out) if options.out.exists() else []
    done = {(row["name"], row["setting"]) for row in rows}
    for setting in ("free",) if options.others else tuple(SPLATS):
        for name, (mesh, truth) in shapes(options.data, others=options.others).items():
            path = options.scenes / f"{name} {setting}.ply"
            if not path.exists():
                known[path.name] = trained(mesh, setting, path)
                ratios.write_text(json.dumps(known))
            if (name, setting) in done:
                continue
            rows.append(
                {"name": name, "setting": setting, "truth": truth, **known[path.name], **answered(path, setting)}
            )
            with options.out.open("a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print("| shape | genus | setting | PSNR | answer | verdict | rims |\n|---|---|---|---|---|---|---|")
    for row in rows:
        cells = [row["name"], row["truth"], row["setting"], f"{row['psnr']:.1f}", row["genus"], row["verdict"]]
        print("| " + " | ".join(map(str, (*cells, len(row.get("rims", ()))))) + " |")
    for setting in dict.fromkeys(row["setting"] for row in rows):
        part = [row for row in rows if row["setting"] == setting]
        right = [row["genus"] == row["truth"] for row in part]
        sure = [is_right for row, is_right in zip(part, right, strict=True) if row["verdict"] == "likely"]
        print(
            f"{setting}: {len(part)} scenes, right {sum(right)}, likely {len(sure)}, wrong likely {sure.count(False)}"
        )


if __name__ == "__main__":
    main()
