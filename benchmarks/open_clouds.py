"""Clouds that planes, boxes, spheres and one-sided scans cut from closed meshes: are any of them called closed?

    python benchmarks/open_clouds.py DATA --cuts 200 --out open.jsonl

DATA holds index.json and the closed meshes that it names. A cut is a mesh, 5 000, 10 000 or 30 000 random points of
it, with or without normals, and the part of these that is kept. A scan keeps what is seen from far away in one
direction. `--out` is continued if it exists. A hole is as wide as the largest ball in the mesh whose center lies on the
missing cap. Those narrower than `report().resolution` are counted apart: an answer claims nothing about them. The
controls are the same points before they are cut.

A second table compares open answers with χ, the components and the rims of the mesh without the part that was cut off,
however small these are. What a scan sees has no such truth.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from confidence import clean_meshes, read_rows
from numpy.typing import NDArray
from scale_truth import mesh_of, raycaster
from skimage.measure import marching_cubes

import topokit as tk
from topokit.core.labels import connected_labels

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]

SIZES, SIZE_SHARES = (5_000, 10_000, 30_000), (0.4, 0.4, 0.2)
KINDS, KIND_SHARES = ("plane", "box", "sphere", "scan"), (0.4, 0.25, 0.2, 0.15)
FEWEST = 400  # points that must be left
STEPS = 128  # of the grid on which caps are looked for, along the longest side
EDGES = 40  # along the longest side of a mesh whose vertices tell on which side of a cut its parts are, at least


@dataclass(frozen=True)
class Cut:
    """What is kept of a cloud.

    Attributes:
        kept: (N,) bool.
        width: of the widest hole, in units of length.
        truth: χ, components and rims of what is left of the mesh, or None if that is not known.
    """

    kept: Booleans
    width: float
    truth: tuple[int, int, int] | None


def cut(kind: str, mesh: trimesh.Trimesh, points: Floats, normals: Floats, rng: np.random.Generator) -> Cut:
    """A random part of the points, and how wide the hole is that is left."""
    if kind == "scan":
        return Cut(seen(mesh, points, normals, rng), float(np.ptp(points, axis=0).max()), None)
    side = {"plane": half_space, "box": box, "sphere": ball}[kind](points, rng)
    return Cut(side(points) > 0, hole_width(mesh, side), what_is_left(mesh, side))


def half_space(points: Floats, rng: np.random.Generator) -> Callable[[Floats], Floats]:
    """One side of a plane, along an axis or not."""
    along = rng.normal(size=3) if rng.random() < 0.5 else np.eye(3)[rng.integers(3)] * rng.choice((-1, 1))
    along = along / np.linalg.norm(along)
    level = np.quantile(points @ along, rng.uniform(0.05, 0.95))
    return lambda x: level - x @ along


def box(points: Floats, rng: np.random.Generator) -> Callable[[Floats], Floats]:
    """A crop box around the middle, or all but a box around a point."""
    size = np.ptp(points, axis=0)
    if rng.random() < 0.5:
        center, half = np.median(points, axis=0), size * rng.uniform(0.25, 0.45, size=3)
        return lambda x: 1 - np.abs((x - center) / half).max(1)
    center, half = points[rng.integers(len(points))], size * rng.uniform(0.1, 0.6, size=3)
    return lambda x: np.abs((x - center) / half).max(1) - 1


def ball(points: Floats, rng: np.random.Generator) -> Callable[[Floats], Floats]:
    """A ball around a point, or all but one."""
    center, radius = points[rng.integers(len(points))], np.ptp(points, axis=0).max() * rng.uniform(0.08, 0.6)
    sign = rng.choice((-1, 1))
    return lambda x: sign * (radius - np.linalg.norm(x - center, axis=1))


def seen(mesh: trimesh.Trimesh, points: Floats, normals: Floats, rng: np.random.Generator) -> Booleans:
    """What faces one direction and is not hidden behind other points, by a depth buffer."""
    towards = rng.normal(size=3)
    towards /= np.linalg.norm(towards)
    across = np.linalg.svd(towards[None])[2][1:]
    spacing = np.sqrt(mesh.area / len(points))
    pixel = np.unique(np.floor(points @ across.T / (2.5 * spacing)), axis=0, return_inverse=True)[1].ravel()
    depth, front = points @ towards, np.full(pixel.max() + 1, -np.inf)
    np.maximum.at(front, pixel, depth)
    return np.asarray((normals @ towards > 0) & (depth > front[pixel] - 4 * spacing))


def hole_width(mesh: trimesh.Trimesh, side: Callable[[Floats], Floats]) -> float:
    """Width of the largest ball in a closed mesh whose center lies where the side is zero: in the missing cap."""
    low, high = mesh.bounds
    step = float((high - low).max()) / STEPS
    ticks = [np.arange(first - step, last + 2 * step, step) for first, last in zip(low, high, strict=True)]
    value = side(np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3))
    if not value.min() < 0 < value.max():
        return 0.0  # the hole is narrower than the grid sees
    grid = value.reshape([len(tick) for tick in ticks])
    places = marching_cubes(grid, 0.0, spacing=(step,) * 3)[0] + [tick[0] for tick in ticks]
    depth = -raycaster(mesh).compute_signed_distance(np.float32(places)).numpy()
    return 2 * max(float(depth.max()), 0.0)


def what_is_left(mesh: trimesh.Trimesh, side: Callable[[Floats], Floats]) -> tuple[int, int, int]:
    """χ, components and rims of the part of a closed mesh on the positive side.

    The part is homotopic to the vertices there with the edges and faces between them; a rim runs through the faces
    with vertices on both sides.
    """
    size = float(np.ptp(mesh.vertices, axis=0).max())
    vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, size / EDGES, max_iter=20)
    merged = trimesh.Trimesh(vertices, faces, process=True)
    is_left = side(np.asarray(merged.vertices)) > 0
    edges = merged.edges_unique[is_left[merged.edges_unique].all(1)]
    label = connected_labels(len(is_left), *edges.T)
    n_faces = int(is_left[merged.faces].all(1).sum())
    crossing = is_left[merged.faces].any(1) & ~is_left[merged.faces].all(1)
    first, second = merged.face_adjacency.T
    across = is_left[merged.face_adjacency_edges].any(1) & ~is_left[merged.face_adjacency_edges].all(1)
    rim = connected_labels(len(merged.faces), first[across], second[across])
    euler = int(is_left.sum()) - len(edges) + n_faces
    return euler, len(np.unique(label[is_left])), len(np.unique(rim[crossing]))


def examined(number: int, names: list[str], folder: Path, rows: dict[str, dict[str, Any]]) -> dict[str, Any] | None:
    """The reports of one cut cloud and of the same points before the cut; None if too few points are left."""
    rng = np.random.default_rng([27, number])
    name = str(names[rng.integers(len(names))])
    kind, size = str(rng.choice(KINDS, p=KIND_SHARES)), int(rng.choice(SIZES, p=SIZE_SHARES))
    with_normals = bool(rng.random() < 1 / 3)
    mesh = mesh_of(folder / rows[name]["path"])
    points, face = trimesh.sample.sample_surface(mesh, size, seed=number)
    points, normals = np.asarray(points, dtype=np.float64), np.asarray(mesh.face_normals[face])
    part = cut(kind, mesh, points, normals, rng)
    if not FEWEST <= part.kept.sum() <= size - FEWEST // 4:
        return None

    def report(kept: Booleans) -> tk.TopologyReport:
        own = torch.from_numpy(normals[kept]) if with_normals else None
        return tk.from_points(torch.from_numpy(points[kept]), own).report()

    found, control = report(part.kept), report(np.ones(size, dtype=bool))
    return {
        "number": number,
        "shape": name,
        "kind": kind,
        "points": size,
        "normals": with_normals,
        "width": part.width / found.resolution,
        "truth": part.truth,
        "answer": (found.euler, found.components, found.boundary_loops),
        "verdict": found.verdict,
        "closed": found.closed,
        "control": control.verdict,
        "control_closed": control.closed,
    }


def print_table(rows: list[dict[str, Any]]) -> None:
    """One line for each kind of cut, size and kind of input: what was said of the cut clouds and of the controls."""
    print(
        "| cut by | clouds | open | closed, unsure | closed, likely | narrow holes | controls likely | controls open |"
    )
    print("|---" * 8 + "|")
    keys = [("kind", kind) for kind in KINDS] + [("points", size) for size in SIZES]
    for key, value in [*keys, ("normals", True), ("normals", False), (None, "all")]:
        own = [row for row in rows if key is None or row[key] == value]
        wide = [row for row in own if row["width"] >= 1]
        closed = [row for row in wide if row["closed"]]
        likely = sum(row["verdict"] == "likely" for row in closed)
        label = value if key != "normals" else ("with normals" if value else "without normals")
        print(
            f"| {label} | {len(wide)} | {len(wide) - len(closed)} | {len(closed) - likely} | {likely} | "
            f"{len(own) - len(wide)} | {sum(row['control'] == 'likely' for row in own)} | "
            f"{sum(not row['control_closed'] for row in own)} |"
        )


def print_open_table(rows: list[dict[str, Any]]) -> None:
    """How many open answers of cut clouds are right."""
    print(
        "\n| cut by | open | χ right | rims and components, too | likely | likely, χ wrong | rims or components wrong |"
    )
    print("|---" * 7 + "|")
    for kind in (*KINDS[:3], None):
        own = [row for row in rows if row["truth"] and not row["closed"] and kind in (None, row["kind"])]
        likely = [row for row in own if row["verdict"] == "likely"]
        n_right, n_known = sum(map(has_right_euler, own)), sum(map(is_right, own))
        n_wrong = len(likely) - sum(map(has_right_euler, likely))
        n_rims = len(likely) - sum(map(is_right, likely))
        print(f"| {kind or 'all'} | {len(own)} | {n_right} | {n_known} | {len(likely)} | {n_wrong} | {n_rims} |")


def has_right_euler(row: dict[str, Any]) -> bool:
    return bool(row["answer"][0] == row["truth"][0])


def is_right(row: dict[str, Any]) -> bool:
    return list(row["answer"]) == list(row["truth"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--cuts", type=int, default=200)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    meshes = clean_meshes(options.data)
    rows = read_rows(options.out) if options.out.exists() else []
    number = max((row["number"] for row in rows), default=-1) + 1
    with options.out.open("a", encoding="utf-8") as file:
        while len(rows) < options.cuts:
            row = examined(number, sorted(meshes), options.data, meshes)
            number += 1
            if row is not None:
                rows.append(row)
                file.write(json.dumps(row) + "\n")
                file.flush()
    print_table(rows)
    print_open_table(rows)


if __name__ == "__main__":
    main()
