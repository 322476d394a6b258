"""Calibrate the confidence of reports on point clouds: collect answers of known truth, fit the model, check it.

    python benchmarks/confidence.py collect DATA --draws 1000 --out answers.jsonl [--part 0/2]
    python benchmarks/confidence.py fit answers.jsonl [--diagram reliability.png]

DATA holds index.json and the closed meshes that it names with their Euler characteristic. A draw is a shape (one of
these, a random solid of `random_solids.py`, or a solid of `planted.py` whose features are 0.2 to 20 sample spacings
wide), a number of points from 150 to 40 000, a pattern of samples, noise from 0 to 2 % of the longest side, with or
without normals. An answer is right if it is that of the solid without features narrower than the report's resolution.
`collect` continues a file that it finds. `fit` leaves whole families out: every probability that it shows comes from a
model that has seen no shape of the family. Needs manifold3d and open3d.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray
from planted import FAMILIES, Planted, planted
from random_solids import random_solid
from scale_truth import mesh_of, right_at_scale
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import topokit as tk
from topokit.report.confidence import EVIDENCE, cloud_evidence

Floats = NDArray[np.float64]

SIZES = (150, 500, 1_500, 3_000, 6_000, 10_000, 40_000)
SIZE_SHARES = (0.05, 0.1, 0.15, 0.25, 0.2, 0.2, 0.05)  # the large ones cost most
NOISES = (0.0, 0.0025, 0.005, 0.01, 0.02)
NOISE_SHARES = (0.5, 0.15, 0.2, 0.1, 0.05)
PATTERNS = ("random", "farthest", "cells", "uneven")
PATTERN_SHARES = (0.7, 0.12, 0.1, 0.08)
ORIENTED_SHARE = 1 / 4  # of the draws without noise
KINDS = ("real", "solid", "planted")
KIND_SHARES = (0.2, 0.2, 0.6)
N_SOLIDS = 60  # random solids among which the draws choose
RIDGE = 0.02  # weight of the squared coefficients, per answer: keeps unimportant evidence near zero
MOST_WRONG = 0.02  # share of the likely answers that may be wrong


@dataclass(frozen=True)
class Draw:
    """One sampling of one shape; the same for the same number."""

    number: int
    family: str
    shape: str
    n_points: int
    noise: float
    oriented: bool
    pattern: str


def draws(count: int, names: Sequence[str]) -> Iterator[Draw]:
    """Random draws, each from its own generator."""
    for number in range(count):
        rng = np.random.default_rng([12, number])
        family = str(rng.choice(KINDS, p=KIND_SHARES))
        n_points, noise = int(rng.choice(SIZES, p=SIZE_SHARES)), float(rng.choice(NOISES, p=NOISE_SHARES))
        oriented = bool(noise == 0 and rng.random() < ORIENTED_SHARE)
        pattern = str(rng.choice(PATTERNS, p=PATTERN_SHARES))
        if family == "planted":
            family = str(rng.choice(list(FAMILIES)))
            shape = f"{family} {number}"
        else:
            shape = str(rng.choice(names)) if family == "real" else f"solid {rng.integers(N_SOLIDS)}"
        yield Draw(number, family, shape, n_points, noise, oriented, pattern)


def clean_meshes(folder: Path) -> dict[str, dict[str, Any]]:
    """The closed meshes of known truth, by name."""
    rows = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    return {
        row["name"]: row for row in rows if row["kind"] == "mesh" and row.get("clean_truth") and row["genus"] < 1000
    }


def solid_of(draw: Draw, folder: Path, rows: dict[str, dict[str, Any]]) -> Planted:
    """The mesh of a draw, its Euler characteristic, and what is known of its features."""
    if draw.family in FAMILIES:
        return planted(draw.family, draw.number, draw.n_points)
    if draw.family == "real":
        return Planted(mesh_of(folder / rows[draw.shape]["path"]), rows[draw.shape]["chi"], ())
    mesh = random_solid(int(draw.shape.split()[1]))
    return Planted(mesh, mesh.euler_number, ())


def sampled(mesh: trimesh.Trimesh, draw: Draw) -> tuple[Floats, NDArray[np.int64]]:
    """Points (n, 3) of a mesh in the pattern of a draw, without noise, and the face of each."""
    if draw.pattern == "random":
        return trimesh.sample.sample_surface(mesh, draw.n_points, seed=draw.number)
    many = (4 if draw.pattern == "cells" else 3) * draw.n_points
    points, face = trimesh.sample.sample_surface(mesh, many, seed=draw.number)
    rng = np.random.default_rng([13, draw.number])
    if draw.pattern == "farthest":
        kept = farthest(points, min(draw.n_points, 3_000), rng)  # its time grows with the square
    elif draw.pattern == "cells":
        side = np.sqrt(mesh.area / draw.n_points)
        kept = np.unique(np.floor(points / side), axis=0, return_index=True)[1]
    else:
        height = points @ Rotation.random(rng=rng).as_matrix()[0]
        density = np.exp(-2.5 * (height - height.min()) / np.ptp(height))  # twelve times fewer at one end
        kept = rng.choice(many, draw.n_points, replace=False, p=density / density.sum())
    return points[kept], face[kept]


def farthest(points: Floats, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Indices of farthest-point samples."""
    kept = [int(rng.integers(len(points)))]
    distance = np.full(len(points), np.inf)
    for _ in range(count - 1):
        distance = np.minimum(distance, ((points - points[kept[-1]]) ** 2).sum(1))
        kept.append(int(distance.argmax()))
    return np.array(kept)


def is_right(solid: Planted, report: tk.TopologyReport) -> bool:
    """Whether a report's integer is that of the solid without features narrower than its resolution."""
    if report.euler is None or report.resolution is None:
        return False
    known = solid.right_at(report.euler, report.resolution)
    return known if known or solid.features else right_at_scale(solid.mesh, report.euler, report.resolution)


def answer(draw: Draw, solid: Planted) -> dict[str, Any]:
    """What the report says of a draw, with its evidence."""
    mesh = solid.mesh
    clean, face = sampled(mesh, draw)
    points = np.asarray(clean, dtype=np.float64)
    length = np.ptp(points, axis=0).max()
    points = points + np.random.default_rng(draw.number).normal(size=points.shape) * draw.noise * length
    normals = torch.from_numpy(mesh.face_normals[face].copy()) if draw.oriented else None
    started = time.process_time()
    shape = tk.from_points(torch.from_numpy(points), normals=normals)
    report = shape.report()
    found = shape._known.examination()
    witness, boundary = found.witness, found.part.boundary
    closed = witness is not None and report.closed and witness.wire is None
    return {
        **vars(draw),
        "truth": int(solid.euler),
        "euler": report.euler,
        "right": is_right(solid, report),
        "verdict": report.verdict,
        "resolution": report.resolution,
        "spacing": None if witness is None else witness.spacing,
        "closed": closed,
        "evidence": cloud_evidence(witness) if witness is not None and closed else None,
        "votes": [(vote.family, vote.eulers) for vote in witness.votes] if witness is not None else [],
        "quality": None if witness is None else asdict(witness.quality),
        "preparation": None if witness is None else witness.preparation,
        "source": None if witness is None else witness.signs.source,
        "wire": witness is not None and witness.wire is not None,
        "repeated": witness is not None and witness.is_smoothed,
        "widened": witness is not None and witness.is_shifted,
        "boundaries": len(boundary.curves),
        "doubts": [(one.kind, one.width, one.change, one.votes) for one in found.doubts or ()],
        "seconds": round(time.process_time() - started, 2),
    }


def collect(options: argparse.Namespace) -> None:
    """Add the answers of the draws that the file lacks."""
    known = {row["number"] for row in read_rows(options.out)} if options.out.exists() else set()
    rows = clean_meshes(options.data)
    part, parts = map(int, options.part.split("/"))
    with options.out.open("a") as file:
        for draw in draws(options.draws, sorted(rows)):
            if draw.number % parts == part and draw.number not in known:
                file.write(json.dumps(answer(draw, solid_of(draw, options.data, rows))) + "\n")
                file.flush()


def read_rows(path: Path) -> list[dict[str, Any]]:
    """The answers of a file."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def fit_model(evidence: Floats, right: Floats) -> Floats:
    """Coefficients (1 + n,) of a logistic model: an intercept, and one of each doubt, none of which may help.

    Args:
        evidence: (m, n), doubts, 0 where there is none.
        right: (m,), 1 for right answers.
    """
    design = np.hstack([np.ones((len(evidence), 1)), -evidence])
    signs = np.where(right > 0, 1.0, -1.0)

    def loss(w: Floats) -> tuple[float, Floats]:
        margin = signs * (design @ w)
        gradient = -(signs / (1 + np.exp(margin))) @ design / len(right)
        penalty = np.append(0.0, w[1:])
        value = np.logaddexp(0, -margin).mean() + 0.5 * RIDGE * (penalty @ penalty) / len(w)
        return float(value), gradient + RIDGE * penalty / len(w)

    bounds = [(None, None)] + [(0, None)] * evidence.shape[1]
    found = minimize(loss, np.zeros(design.shape[1]), jac=True, bounds=bounds, method="L-BFGS-B")
    return np.asarray(found.x)


def probabilities(coefficients: Floats, evidence: Floats) -> Floats:
    """(m,) probabilities that the answers are right."""
    return np.asarray(1 / (1 + np.exp(-(coefficients[0] - evidence @ coefficients[1:]))))


def left_out(evidence: Floats, right: Floats, families: NDArray[np.str_]) -> Floats:
    """(m,) probabilities, each from a model fitted to all other families."""
    result = np.empty(len(right))
    for family in np.unique(families):
        own = families == family
        result[own] = probabilities(fit_model(evidence[~own], right[~own]), evidence[own])
    return result


def likely_limit(probability: Floats, right: Floats) -> float:
    """Smallest probability from which at most `MOST_WRONG` of the answers are wrong."""
    order = np.argsort(-probability)
    wrong = np.cumsum(1 - right[order]) / np.arange(1, len(order) + 1)
    good = np.flatnonzero(wrong <= MOST_WRONG)
    return float(probability[order][good[-1]]) if len(good) else 1.0


def print_rows(title: str, probability: Floats, right: Floats, limit: float) -> None:
    """One line: Brier score, likely answers, share of the right ones that are likely, wrong ones."""
    likely = probability >= limit
    brier = float(((probability - right) ** 2).mean())
    base = float(right.mean() * (1 - right.mean()))
    caught = float(likely[right > 0].mean()) if right.any() else 0.0
    wrong = int((1 - right[likely]).sum())
    print(
        f"{title:<24}{len(right):>6}{right.mean():>8.1%}{brier:>8.3f}{base:>8.3f}{likely.sum():>8}{caught:>9.1%}{wrong:>7}"
    )


def fit(options: argparse.Namespace) -> None:
    """Fit, validate with whole families left out, print everything."""
    rows = [row for path in options.answers for row in read_rows(path) if row["evidence"] is not None]
    evidence = np.array([[one.of(row["evidence"][name]) for name, one in EVIDENCE.items()] for row in rows])
    right = np.array([float(row["right"]) for row in rows])
    families = np.array([row["family"] for row in rows])
    probability = left_out(evidence, right, families)
    limit = likely_limit(probability, right)
    n_exact = sum(row["euler"] == row["truth"] for row in rows)
    print(
        f"{len(rows)} answers, {n_exact} right for all features; probabilities from models without the answer's family"
    )
    print(f"likely from {limit:.3f}\n")
    print(f"{'':<24}{'n':>6}{'right':>8}{'Brier':>8}{'base':>8}{'likely':>8}{'of right':>9}{'wrong':>7}")
    print_rows("all", probability, right, limit)
    for key, values in (
        ("family", sorted(set(families))),
        ("n_points", SIZES),
        ("noise", NOISES),
        ("pattern", PATTERNS),
        ("oriented", (True, False)),
    ):
        for value in values:
            own = np.array([row[key] == value for row in rows])
            if own.any():
                print_rows(f"{key} {value}", probability[own], right[own], limit)
    print("\nreliability: predicted, observed, answers")
    for low in np.arange(0, 1, 0.1):
        own = (probability >= low) & (probability < low + 0.1 + (low > 0.85))
        if own.any():
            print(f"{probability[own].mean():>10.3f}{right[own].mean():>10.3f}{own.sum():>8}")
    coefficients = fit_model(evidence, right)
    print("\ncoefficients of all answers")
    for name, value in zip(("intercept", *EVIDENCE), coefficients, strict=True):
        print(f"    {name:<20}{value:>8.3f}")
    if options.diagram:
        draw_diagram(options.diagram, probability, right)


def draw_diagram(path: Path, probability: Floats, right: Floats, n_bins: int = 10) -> None:
    """Reliability diagram: observed share of right answers against predicted probability, in bins of equal count."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    bins = np.array_split(np.argsort(probability), n_bins)
    predicted = [probability[own].mean() for own in bins]
    observed = [right[own].mean() for own in bins]
    spread = [np.sqrt(max(o * (1 - o), 0.25 / len(own)) / len(own)) for o, own in zip(observed, bins, strict=True)]
    figure, axes = plt.subplots(figsize=(4.2, 4))
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    axes.errorbar(predicted, observed, yerr=spread, fmt="o", markersize=4, capsize=2)
    axes.set(xlabel="confidence", ylabel="share of right answers", xlim=(0, 1.02), ylim=(0, 1.02))
    figure.savefig(path, dpi=150, bbox_inches="tight")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    gather = commands.add_parser("collect")
    gather.add_argument("data", type=Path)
    gather.add_argument("--draws", type=int, default=1000)
    gather.add_argument("--out", type=Path, required=True)
    gather.add_argument("--part", default="0/1", help="K/M: every M-th draw, beginning with K")
    gather.set_defaults(run=collect)
    estimate = commands.add_parser("fit")
    estimate.add_argument("answers", type=Path, nargs="+")
    estimate.add_argument("--diagram", type=Path)
    estimate.set_defaults(run=fit)
    options = parser.parse_args()
    options.run(options)


if __name__ == "__main__":
    main()
