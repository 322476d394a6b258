"""Whether `Shape.surface()` has the reported topology, on real shapes: closed, outward, and counting to the integer.

    python benchmarks/surfaces.py DATA [--only KIND ...] [--limit N]

DATA holds index.json and the files that it names. Kinds: networks; volumes, under both connectivities; samples of the
clean meshes as clouds (oriented, unoriented, noisy) and as splats; captures (splat files); scans (point files). Of the
shapes answered "certain" or "likely" every surface must be right: trimesh finds it watertight and wound consistently,
its solids have positive volume, and V − E + F is `report().euler`. The unsure ones are counted, too.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from scipy.spatial.transform import Rotation
from torch import Tensor

import topokit as tk

Named = tuple[str, Callable[[], tk.Shape]]
KINDS = ("networks", "volumes", "oriented", "unoriented", "noisy", "splats", "captures", "scans")
N_POINTS, N_SPLATS = 10_000, 8_000
NOISE = 0.005  # of the longest side, in noisy clouds


def cloud(mesh: trimesh.Trimesh, kind: str) -> tuple[Tensor, Tensor | None]:
    """Random points of a mesh, with normals if the kind is "oriented", displaced if it is "noisy"."""
    points, face = trimesh.sample.sample_surface(mesh, N_POINTS, seed=0)
    points = np.asarray(points, dtype=np.float64)
    if kind == "noisy":
        noise = np.random.default_rng(0).normal(size=points.shape)
        points = points + NOISE * np.ptp(points, axis=0).max() * noise
    normals = torch.from_numpy(mesh.face_normals[face].copy()) if kind == "oriented" else None
    return torch.from_numpy(points), normals


def network(path: Path) -> Callable[[Tensor], Tensor]:
    """A multilayer perceptron of the collection, negative inside."""
    stored = np.load(path, allow_pickle=True)
    layers = sum(name.startswith("W") for name in stored.files)
    if layers:
        weights = [(torch.from_numpy(stored[f"W{i}"]), torch.from_numpy(stored[f"b{i}"])) for i in range(layers)]
        names = ["relu"] * (layers - 1) + ["tanh"]
    else:
        dense = sorted(name for name in stored.files if name.endswith("dense.A"))
        weights = [(torch.from_numpy(stored[name]), torch.from_numpy(stored[f"{name[:-1]}b"])) for name in dense]
        kinds = {name.split(".")[0]: name.split(".")[1] for name in stored.files if ".dense." not in name}
        names = [kinds.get(f"{int(name.split('.')[0]) + 1:04d}", "none") for name in dense]
    active = {"relu": torch.relu, "elu": torch.nn.functional.elu, "tanh": torch.tanh}

    def evaluate(x: Tensor) -> Tensor:
        for (weight, bias), name in zip(weights, names, strict=True):
            x = torch.addmm(bias.to(x), x, weight.to(x))
            x = active[name](x) if name in active else x
        return x[:, 0]

    return evaluate


def volume(path: Path, connectivity: int) -> tk.Shape:
    stored = np.load(path)
    spacing = tuple(float(step) for step in np.atleast_1d(stored["spacing"]))
    return tk.from_voxels(np.ascontiguousarray(stored["vol"]), spacing=spacing, connectivity=connectivity)


def splats(mesh: trimesh.Trimesh) -> tk.Shape:
    """Flat Gaussians on a mesh, with random spin and a little noise."""
    points, face = trimesh.sample.sample_surface(mesh, N_SPLATS, seed=1)
    draws = np.random.default_rng(1)
    size, normal = np.sqrt(mesh.area / N_SPLATS), mesh.face_normals[face]
    first = np.cross(normal, draws.normal(size=normal.shape))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    axes = np.stack((first, np.cross(normal, first), normal), axis=2)
    scales = np.column_stack((draws.uniform(0.5, 0.9, (N_SPLATS, 2)) * size, np.full(N_SPLATS, 0.03 * size)))
    fields = {
        "means": points + 0.05 * size * draws.normal(size=(N_SPLATS, 1)) * normal,
        "quats": Rotation.from_matrix(axes).as_quat()[:, [3, 0, 1, 2]],
        "scales": np.log(scales),
        "opacities": draws.uniform(1.5, 5, N_SPLATS),
    }
    return tk.from_splats({name: torch.from_numpy(np.ascontiguousarray(values)) for name, values in fields.items()})


def shapes(data: Path, kind: str) -> Iterator[Named]:
    """The shapes of one kind, each opened when it is asked for."""
    rows = json.loads((data / "index.json").read_text(encoding="utf-8"))
    if kind == "networks":
        box = ((-1.0,) * 3, (1.0,) * 3)
        for row in (row for row in rows if row["kind"] == "sdfnet" and row.get("chi") is not None):
            yield row["name"], lambda row=row: tk.from_sdf(network(data / row["path"]), bounds=box)
    elif kind == "volumes":
        for row in (row for row in rows if row["kind"] == "voxels" and row["path"].endswith(".npz")):
            for connectivity in (26, 6):
                yield row["name"], lambda row=row, c=connectivity: volume(data / row["path"], c)
    elif kind in ("captures", "scans"):
        for row in (row for row in rows if row["kind"] == {"captures": "splat", "scans": "points"}[kind]):
            yield row["name"], lambda row=row: tk.load(data / row["path"])
    else:
        for row in (row for row in rows if row["kind"] == "mesh" and row.get("clean_truth") and row["genus"] < 1000):
            mesh = tk.from_mesh(data / row["path"]).surface()
            if kind == "splats":
                yield row["name"], lambda mesh=mesh: splats(mesh)
            else:
                points, normals = cloud(mesh, kind)
                yield row["name"], lambda points=points, normals=normals: tk.from_points(points, normals)


def outcome(shape: tk.Shape) -> dict[str, Any]:
    """The verdict, and what is wrong with the surface ("" if it is right)."""
    report = shape.report()
    started = time.perf_counter()
    try:
        surface = shape.surface()
    except tk.TopokitError as error:
        return {"verdict": report.verdict, "wrong": str(error)[:150], "seconds": 0.0}
    seconds = time.perf_counter() - started
    faults = {
        f"χ = {surface.euler_number}, not {report.euler}": surface.euler_number != report.euler,
        "not watertight": not surface.is_watertight,
        "not consistently wound": not surface.is_winding_consistent,
        "inward": not surface.volume > 0,
    }
    wrong = ", ".join(text for text, is_so in faults.items() if is_so)
    return {"verdict": report.verdict, "wrong": wrong, "seconds": seconds}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--limit", type=int, default=10**9)
    options = parser.parse_args()
    print(f"{'kind':<12}{'sure':>6}{'right':>7}{'unsure':>8}{'right':>7}{'median s':>10}")
    for kind in options.only:
        found = []
        for number, (name, opened) in enumerate(shapes(options.data, kind)):
            if number >= options.limit:
                break
            try:
                found.append(outcome(opened()))
            except tk.TopokitError as error:  # nothing to report about
                print(f"{kind} {name}: {str(error)[:150]}", file=sys.stderr)
                continue
            print(
                f"{kind} {name}: {found[-1]['verdict']}, {found[-1]['wrong'] or 'right'}", file=sys.stderr, flush=True
            )
        sure = [one for one in found if one["verdict"] != "unsure"]
        unsure = [one for one in found if one["verdict"] == "unsure"]
        rights = [sum(not one["wrong"] for one in group) for group in (sure, unsure)]
        median = float(np.median([one["seconds"] for one in found])) if found else 0.0
        print(f"{kind:<12}{len(sure):>6}{rights[0]:>7}{len(unsure):>8}{rights[1]:>7}{median:>10.2f}", flush=True)


if __name__ == "__main__":
    main()
