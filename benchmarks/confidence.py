"""Calibrate the confidence of reports on point clouds: collect answers of known truth, fit the model, check it.

    python benchmarks/confidence.py collect DATA --draws 1000 --out answers.jsonl [--part 0/2]
    python benchmarks/confidence.py fit answers.jsonl [--diagram docs/pictures/reliability.png]

DATA holds index.json and the closed meshes that it names with their Euler characteristic. A draw is a shape (one of
these, or more often a random solid of `random_solids.py`), a number of points from 50 to 200 000, noise from 0 to
1 % of the longest side, with or without normals. `collect` continues a file that it finds. `fit` leaves whole shapes
out: every probability that it shows comes from a model that has not seen the shape.
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
from scipy.optimize import minimize

import topokit as tk
from topokit.report.confidence import EVIDENCE, cloud_evidence

Floats = NDArray[np.float64]

SIZES = (50, 150, 500, 1_500, 3_000, 10_000, 30_000, 100_000, 200_000)
SIZE_SHARES = (0.1, 0.1, 0.1, 0.15, 0.2, 0.25, 0.04, 0.03, 0.03)  # the large ones cost most
NOISES = (0.0, 0.0025, 0.005, 0.01)
NOISE_SHARES = (0.55, 0.15, 0.2, 0.1)
ORIENTED_SHARE = 1 / 3  # of the draws without noise
REAL_SHARE = 0.2  # of the draws are from the meshes of DATA
N_SOLIDS = 300  # random solids among which the draws choose
RIDGE = 0.02  # weight of the squared coefficients, per answer: keeps unimportant evidence near zero
MOST_WRONG = 0.02  # share of the likely answers that may be wrong


@dataclass(frozen=True)
class Draw:
    """One sampling of one shape; the same for the same number."""

    number: int
    shape: str
    n_points: int
    noise: float
    oriented: bool


def draws(count: int, names: Sequence[str]) -> Iterator[Draw]:
    """Random draws, each from its own generator."""
    for number in range(count):
        rng = np.random.default_rng([11, number])
        real = rng.random() < REAL_SHARE
        shape = str(names[rng.integers(len(names))]) if real else f"solid {rng.integers(N_SOLIDS)}"
        n_points, noise = int(rng.choice(SIZES, p=SIZE_SHARES)), float(rng.choice(NOISES, p=NOISE_SHARES))
        yield Draw(number, shape, n_points, noise, bool(noise == 0 and rng.random() < ORIENTED_SHARE))


def clean_meshes(folder: Path) -> dict[str, dict[str, Any]]:
    """The closed meshes of known truth, by name."""
    rows = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    return {
        row["name"]: row for row in rows if row["kind"] == "mesh" and row.get("clean_truth") and row["genus"] < 1000
    }


def mesh_of(draw: Draw, folder: Path, rows: dict[str, dict[str, Any]]) -> tuple[trimesh.Trimesh, int]:
    """The mesh of a draw and its Euler characteristic."""
    if draw.shape in rows:
        shape = tk.from_mesh(folder / rows[draw.shape]["path"])
        assert shape.mesh is not None
        return trimesh.Trimesh(*(part.numpy() for part in shape.mesh), process=False), rows[draw.shape]["chi"]
    from random_solids import random_solid

    mesh = random_solid(int(draw.shape.split()[1]))
    return mesh, mesh.euler_number


def answer(draw: Draw, mesh: trimesh.Trimesh, euler: int) -> dict[str, Any]:
    """What the report says of a draw, with its evidence."""
    points, face = trimesh.sample.sample_surface(mesh, draw.n_points, seed=draw.number)
    points = np.asarray(points, dtype=np.float64)
    points = (
        points
        + np.random.default_rng(draw.number).normal(size=points.shape) * draw.noise * np.ptp(points, axis=0).max()
    )
    normals = torch.from_numpy(mesh.face_normals[face].copy()) if draw.oriented else None
    started = time.perf_counter()
    shape = tk.from_points(torch.from_numpy(points), normals=normals)
    report = shape.report()
    found = shape._known.examination()
    witness, boundary = found.witness, found.part.boundary
    closed = witness is not None and report.closed and witness.wire is None
    return {
        **vars(draw),
        "truth": euler,
        "euler": report.euler,
        "verdict": report.verdict,
        "closed": closed,
        "evidence": cloud_evidence(witness) if witness is not None and closed else None,
        "votes": [(vote.family, vote.eulers) for vote in witness.votes] if witness is not None else [],
        "quality": None if witness is None else asdict(witness.quality),
        "preparation": None if witness is None else witness.preparation,
        "source": None if witness is None else witness.signs.source,
        "wire": witness is not None and witness.wire is not None,
        "repeated": witness is not None and witness.is_repeated,
        "boundaries": len(boundary.curves),
        "seconds": round(time.perf_counter() - started, 2),
    }


def collect(options: argparse.Namespace) -> None:
    """Add the answers of the draws that the file lacks."""
    known = {row["number"] for row in read_rows(options.out)} if options.out.exists() else set()
    rows = clean_meshes(options.data)
    part, parts = map(int, options.part.split("/"))
    with options.out.open("a") as file:
        for draw in draws(options.draws, sorted(rows)):
            if draw.number % parts == part and draw.number not in known:
                file.write(json.dumps(answer(draw, *mesh_of(draw, options.data, rows))) + "\n")
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


def left_out(evidence: Floats, right: Floats, shapes: NDArray[np.str_]) -> Floats:
    """(m,) probabilities, each from a model fitted to all other shapes."""
    result = np.empty(len(right))
    for shape in np.unique(shapes):
        own = shapes == shape
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
    """Fit, validate with whole shapes left out, print everything."""
    rows = [row for path in options.answers for row in read_rows(path) if row["evidence"] is not None]
    evidence = np.array([[one.of(row["evidence"][name]) for name, one in EVIDENCE.items()] for row in rows])
    right = np.array([float(row["euler"] == row["truth"]) for row in rows])
    shapes = np.array([row["shape"] for row in rows])
    probability = left_out(evidence, right, shapes)
    limit = likely_limit(probability, right)
    print(f"{len(rows)} answers on {len(set(shapes))} shapes; every probability from models without the answer's shape")
    print(f"likely from {limit:.3f}\n")
    print(f"{'':<24}{'n':>6}{'right':>8}{'Brier':>8}{'base':>8}{'likely':>8}{'of right':>9}{'wrong':>7}")
    print_rows("all", probability, right, limit)
    for key, values in (("n_points", SIZES), ("noise", NOISES), ("oriented", (True, False))):
        for value in values:
            own = np.array([row[key] == value for row in rows])
            if own.any():
                print_rows(f"{key} {value}", probability[own], right[own], limit)
    for title, own in (
        ("real shapes", np.char.find(shapes, "solid ") < 0),
        ("random solids", np.char.find(shapes, "solid ") == 0),
    ):
        print_rows(title, probability[own], right[own], limit)
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
