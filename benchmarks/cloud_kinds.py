"""Clouds as they come: scans, slices, grids, copies, outliers, small parts and open sheets, with their true numbers.

    python benchmarks/cloud_kinds.py --out kinds.jsonl [--draws 5] [--only lidar terrain ...]

Four solids (a double torus, a drilled plate, a chair and a mug) are sampled in the ways of scanners and programs, and
scenes of many parts and open sheets are drawn. A report is right if its Euler characteristic is the true one and it is
closed or open as the shape is. It is right at its resolution if it is that of the solid without features narrower than
`report().resolution`. The confidence was fitted to none of these but random, farthest and uneven points. `--out` is
continued if it exists. Needs manifold3d and open3d.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from confidence import read_rows
from planted import at
from sampling_patterns import N_POINTS, PATTERNS, Draw, Floats, noisy, samples_of, solids, turned
from scale_truth import right_at_scale
from trimesh.creation import icosphere, torus

import topokit as tk


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points (N, 3) of a surface, its true Euler characteristic, whether it is closed, and its mesh if it has one."""

    points: Floats
    euler: int
    closed: bool = True
    mesh: trimesh.Trimesh | None = None


def capsules(segments: Floats, radii: Floats, count: int, draw: Draw) -> Floats:
    """Points (count, 3) of the union of round tubes with round ends, around segments (m, 2, 3) with radii (m,)."""
    a, way = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(way, axis=1)
    area = 2 * np.pi * radii * length + 4 * np.pi * radii**2
    found: list[Floats] = []
    while sum(map(len, found)) < count:
        part = draw.choice(len(a), 4 * count, p=area / area.sum())
        ball = draw.normal(size=(4 * count, 3))
        ball /= np.linalg.norm(ball, axis=1, keepdims=True)
        axis = way[part] / length[part, None]
        side = ball - (ball * axis).sum(1, keepdims=True) * axis
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        on_side = (draw.random(4 * count) < (2 * np.pi * radii * length / area)[part])[:, None]
        end = draw.integers(0, 2, (4 * count, 1))
        along = np.where(on_side, draw.random((4 * count, 1)), end)
        q = a[part] + along * way[part] + radii[part, None] * np.where(on_side, side, ball)
        t = np.clip(np.einsum("nmk,mk->nm", q[:, None] - a, way) / length**2, 0, 1)
        depth = np.linalg.norm(q[:, None] - a - t[..., None] * way, axis=2) - radii
        found.append(q[depth.min(1) > -1e-9])
    return np.concatenate(found)[:count]


def vessel_tree(draw: Draw) -> Cloud:
    """31 branches that halve and taper; a ball."""
    segments, radii = [], []
    tips = [(np.zeros(3), np.array([0, 0, 1.0]), 0.12, 1.0)]
    for _ in range(5):
        grown = []
        for start, way, radius, length in tips:
            end = start + length * way
            segments.append((start, end))
            radii.append(radius)
            across = np.cross(way, draw.normal(size=3))
            across /= np.linalg.norm(across)
            grown += [(end, (way + 0.8 * s * across) / np.sqrt(1.64), 0.72 * radius, 0.8 * length) for s in (-1, 1)]
        tips = grown
    return Cloud(capsules(np.array(segments), np.array(radii), 20_000, draw), 2)


def strut_lattice(draw: Draw) -> Cloud:
    """The edges of 2 × 2 × 2 cubes as tubes: 54 edges and 27 corners, genus 28."""
    corners = np.stack(np.meshgrid(*[np.arange(3.0)] * 3), -1).reshape(-1, 3)
    pairs = [(p, q) for i, p in enumerate(corners) for q in corners[:i] if abs(p - q).sum() == 1]
    return Cloud(capsules(np.array(pairs), np.full(len(pairs), 0.12), 30_000, draw), 2 * (27 - len(pairs)))


def chain(draw: Draw) -> Cloud:
    """Twelve linked rings."""
    rings = []
    for k in range(12):
        ring = torus(0.5, 0.1, 64, 24)
        ring.apply_transform(at(0.75 * k, 0, 0) @ turned(np.pi / 2 * (k % 2), (1, 0, 0)))
        rings.append(ring)
    return Cloud(samples_of(trimesh.util.concatenate(rings), 20_000, draw), 0)


def _balls(radii: Sequence[float], centers: Floats, count: int, draw: Draw) -> Floats:
    meshes = [icosphere(4, radius) for radius in radii]
    for mesh, center in zip(meshes, centers, strict=True):
        mesh.apply_translation(center)
    return samples_of(trimesh.util.concatenate(meshes), count, draw)


def nested_balls(draw: Draw) -> Cloud:
    return Cloud(_balls((1.0, 0.75, 0.5), np.zeros((3, 3)), 12_000, draw), 6)


def balls_of_all_sizes(draw: Draw) -> Cloud:
    """Twelve balls in a row, with as many points each; gaps are as wide as the smaller ball's radius."""
    radii = np.geomspace(1, 0.02, 12)
    centers = np.cumsum(np.append(0, radii[:-1] + 2 * radii[1:]))[:, None] * np.eye(3)[0]
    return Cloud(np.concatenate([_balls((r,), c[None], 800, draw) for r, c in zip(radii, centers, strict=True)]), 24)


def ellipsoid(half: float) -> Callable[[Draw], Cloud]:
    """A flat ellipsoid of so many sample spacings from side to side."""

    def made(draw: Draw) -> Cloud:
        mesh = icosphere(5)
        mesh.apply_scale((1, 1, half * np.sqrt(2 * np.pi / 8000)))
        return Cloud(samples_of(mesh, 8000, draw), 2, mesh=mesh)

    return made


def _sheet(height: Callable[[Floats, Floats], Floats], euler: int, noise: float = 0.0) -> Callable[[Draw], Cloud]:
    def made(draw: Draw) -> Cloud:
        x, y = draw.uniform(-1, 1, (2, N_POINTS))
        points = np.stack((x, y, height(x, y)), 1)
        return Cloud(noisy(points[np.isfinite(points[:, 2])], noise, draw), euler, closed=False)

    return made


def _hills(x: Floats, y: Floats) -> Floats:
    return 0.15 * np.sin(4 * x) * np.cos(5 * y) + 0.05 * np.sin(11 * x + 3 * y)


def _pierced(x: Floats, y: Floats) -> Floats:
    is_hole = (np.hypot(x - 0.4, y) < 0.25) | (np.hypot(x + 0.4, y) < 0.25)
    return np.where(is_hole, np.nan, 0.3 * (x**2 + y**2))


def cap(draw: Draw) -> Cloud:
    ball = draw.normal(size=(3 * N_POINTS, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    return Cloud(ball[ball[:, 2] > 0.2][:N_POINTS], 1, closed=False)


def moebius(draw: Draw) -> Cloud:
    t, w = draw.uniform(0, 2 * np.pi, N_POINTS), draw.uniform(-0.3, 0.3, N_POINTS)
    around = 1 + w * np.cos(t / 2)
    return Cloud(np.stack((around * np.cos(t), around * np.sin(t), w * np.sin(t / 2)), 1), 0, closed=False)


def room_corner(draw: Draw) -> Cloud:
    points = draw.random((N_POINTS, 3))
    points[np.arange(N_POINTS), draw.integers(0, 3, N_POINTS)] = 0
    return Cloud(points, 1, closed=False)


def tube_without_ends(draw: Draw) -> Cloud:
    t = draw.uniform(0, 2 * np.pi, N_POINTS)
    return Cloud(np.stack((np.cos(t), np.sin(t), draw.uniform(-1, 1, N_POINTS)), 1), 0, closed=False)


SCENES: dict[str, Callable[[Draw], Cloud]] = {
    "vessel tree": vessel_tree,
    "strut lattice, genus 28": strut_lattice,
    "chain of 12 rings": chain,
    "three balls in each other": nested_balls,
    "balls of 1 to 0.02": balls_of_all_sizes,
    "flat ellipsoid, 1 spacing": ellipsoid(0.5),
    "flat ellipsoid, 3 spacings": ellipsoid(1.5),
    "flat ellipsoid, 6 spacings": ellipsoid(3.0),
    "cap": cap,
    "terrain": _sheet(_hills, 1),
    "terrain, noise 0.5 %": _sheet(_hills, 1, 0.005),
    "sheet with two holes": _sheet(_pierced, -1),
    "Möbius strip": moebius,
    "corner of a room": room_corner,
    "tube without ends": tube_without_ends,
}


def cloud_of(kind: str, shape: str, number: int) -> Cloud:
    """A draw of a kind, the same for the same number."""
    draw = np.random.default_rng([17, number, *f"{kind} {shape}".encode()])
    if kind in SCENES:
        return SCENES[kind](draw)
    mesh = solids()[shape]
    return Cloud(PATTERNS[kind](mesh, draw), int(mesh.euler_number), mesh=mesh)


def answer(cloud: Cloud) -> dict[str, Any]:
    """What the report says, and whether it is right."""
    started = time.process_time()
    report = tk.from_points(torch.from_numpy(np.ascontiguousarray(cloud.points))).report()
    seconds = time.process_time() - started
    right = (report.euler, report.closed) == (cloud.euler, cloud.closed)
    at_scale = right
    if not right and report.closed and cloud.mesh is not None and report.resolution is not None:
        at_scale = right_at_scale(cloud.mesh, report.euler, report.resolution)
    return {
        "points": len(cloud.points),
        "truth": cloud.euler,
        "euler": report.euler,
        "closed": report.closed,
        "right": right,
        "right_at_resolution": at_scale,
        "likely": report.verdict == "likely",
        "confidence": report.confidence,
        "resolution": report.resolution,
        "seconds": round(seconds, 2),
    }


def collect(options: argparse.Namespace) -> None:
    """Add the answers that the file lacks."""
    rows = read_rows(options.out) if options.out.exists() else []
    known = {(row["kind"], row["shape"], row["draw"]) for row in rows}
    with options.out.open("a") as file:
        for number in range(options.draws):
            for kind in options.only or (*PATTERNS, *SCENES):
                for shape in solids() if kind in PATTERNS else ("",):
                    if (kind, shape, number) not in known:
                        row = {"kind": kind, "shape": shape, "draw": number, **answer(cloud_of(kind, shape, number))}
                        file.write(json.dumps(row) + "\n")
                        file.flush()


def print_table(rows: list[dict[str, Any]]) -> None:
    """Right answers by kind."""
    print("| points | right | at the resolution | likely | of these wrong | wrong at it | CPU s, median, most |")
    print("|---" * 7 + "|")
    for kind in (*PATTERNS, *SCENES):
        own = [row for row in rows if row["kind"] == kind]
        if own:
            likely = [row for row in own if row["likely"]]
            right, at_scale = (sum(row[key] for row in own) for key in ("right", "right_at_resolution"))
            wrong, wrong_at = (sum(not row[key] for row in likely) for key in ("right", "right_at_resolution"))
            seconds = [row["seconds"] for row in own]
            times = f"{np.median(seconds):.1f}, {max(seconds):.1f}"
            print(f"| {kind} | {right} / {len(own)} | {at_scale} | {len(likely)} | {wrong} | {wrong_at} | {times} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--draws", type=int, default=5)
    parser.add_argument("--only", nargs="*")
    options = parser.parse_args()
    collect(options)
    print_table(read_rows(options.out))


if __name__ == "__main__":
    main()
