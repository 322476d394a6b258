"""Where the thresholds of a cloud's verdict lie between right and wrong answers, and what moving each would change.

    python benchmarks/verdict_thresholds.py DATA [--seeds 0 1] [--points 10000] [--limit N] [--json OUT]

DATA holds index.json and the closed meshes that it names with their Euler characteristic. Each mesh is sampled with
normals, without, and without and with Gaussian noise of 0.5 % of the longest side. For every threshold of
`topokit.report.verdict` the table shows its quantity among right and among wrong answers (median and the worse tail),
and how many answers are likely, and wrong among them, when it alone is tightened or loosened by a fifth.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
import trimesh
from torch import Tensor

import topokit as tk
from topokit.report.examination import Examination
from topokit.report.verdict import THRESHOLDS, cloud_checks

NOISE = 0.005


@dataclass(frozen=True)
class Answer:
    """One answer: whether it is right, and the value of every check with its outcome."""

    name: str
    kind: str
    seed: int
    right: bool
    values: dict[str, float]
    passed: dict[str, bool]


def clouds(mesh: trimesh.Trimesh, n_points: int, seed: int) -> Iterator[tuple[str, Tensor, Tensor | None]]:
    """Samples with normals, without, and without and with noise."""
    points, face = trimesh.sample.sample_surface(mesh, n_points, seed=seed)
    points = np.asarray(points, dtype=np.float64)
    plain = torch.from_numpy(points)
    yield "oriented", plain, torch.from_numpy(mesh.face_normals[face].copy())
    yield "unoriented", plain, None
    jitter = np.random.default_rng(seed).normal(size=points.shape)
    yield "noisy", torch.from_numpy(points + NOISE * np.ptp(points, axis=0).max() * jitter), None


def answers(folder: Path, seeds: list[int], n_points: int, limit: int) -> Iterator[Answer]:
    """Answers about every clean closed mesh of genus below 1 000."""
    rows = json.loads((folder / "index.json").read_text())
    clean = [row for row in rows if row["kind"] == "mesh" and row.get("clean_truth") and row["genus"] < 1000]
    for row in clean[:limit]:
        shape = tk.from_mesh(folder / row["path"])
        assert shape.mesh is not None
        mesh = trimesh.Trimesh(*(part.numpy() for part in shape.mesh), process=False)
        for seed in seeds:
            for kind, points, normals in clouds(mesh, n_points, seed):
                samples = tk.from_points(points, normals).samples
                found = Examination(samples, known_closed=False)
                if found.witness is None or found.boundary.curves:
                    continue  # taken for open: no integer of a closed surface is claimed
                checks = cloud_checks(found.witness, found.boundary)
                yield Answer(
                    row["name"],
                    kind,
                    seed,
                    found.witness.euler == row["chi"],
                    {check.name: check.value for check in checks},
                    {check.name: check.passed for check in checks},
                )
        print(row["name"], file=sys.stderr)


def likely(found: list[Answer], name: str = "", limit: float = 0.0) -> tuple[int, int]:
    """How many answers are likely, and how many of these are wrong, with another limit for one threshold."""
    chosen = []
    for answer in found:
        passed = dict(answer.passed)
        if name in passed:
            value = answer.values[name]
            passed[name] = value <= limit if is_upper(name) else value >= limit
        if all(passed.values()):
            chosen.append(answer)
    return len(chosen), sum(not answer.right for answer in chosen)


def is_upper(name: str) -> bool:
    """Whether the threshold is a largest allowed value."""
    return "at most" in THRESHOLDS[name].meaning


def print_table(found: list[Answer]) -> None:
    """One row per threshold that a cloud's checks use."""
    right, wrong = sum(answer.right for answer in found), sum(not answer.right for answer in found)
    print(f"{len(found)} closed answers, {right} right, {wrong} wrong; likely {likely(found)}")
    print(f"{'threshold':<14}{'limit':>8}{'right':>18}{'wrong':>18}{'tighter':>12}{'looser':>12}")
    for name, threshold in THRESHOLDS.items():
        known = [answer for answer in found if name in answer.values]
        if not known:
            continue
        columns = [[answer.values[name] for answer in known if answer.right is right] for right in (True, False)]
        tail = 0.9 if is_upper(name) else 0.1
        cells = [f"{np.median(c):.4g}, {np.quantile(c, tail):.4g}" if c else "–" for c in columns]
        factor = 0.8 if is_upper(name) else 1.2
        counts = ["{}, {}".format(*likely(found, name, threshold.value * one)) for one in (factor, 1 / factor)]
        print(f"{name:<14}{threshold.value:>8g}{cells[0]:>18}{cells[1]:>18}{counts[0]:>12}{counts[1]:>12}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--limit", type=int, default=10**9)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found = list(answers(options.data, options.seeds, options.points, options.limit))
    for kind in ("oriented", "unoriented", "noisy"):
        print(f"\n{kind}")
        print_table([answer for answer in found if answer.kind == kind])
    if options.json:
        options.json.write_text(json.dumps([asdict(answer) for answer in found], indent=1))


if __name__ == "__main__":
    main()
