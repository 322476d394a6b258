"""Widths of planted features, measured on meshes and on points sampled from them.

    python benchmarks/planted_widths.py [--draws 6] [--points 10000] [--json FILE]

Solids of `planted.py` have tunnels, rods, parts, cavities and walls of known widths. `features()` of the mesh is
compared with the planted widths: those that nothing else limits, as the thickness of a plate limits its holes. Features
of a cloud are compared with those of its mesh: those wider than the resolution of the cloud should be there, about as
wide. In the cloud they are looked for from three quarters of that width on, since they may seem narrower.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
import trimesh
from planted import FAMILIES, Planted, planted
from scipy.optimize import linear_sum_assignment

import topokit as tk
from topokit.core.scale.features import KINDS, Feature

MEASURED = {
    "perforated": ("tunnel", "opening"),
    "ladder": ("tunnel", "thickness"),
    "loops": ("tunnel", "thickness"),
    "cavities": ("cavity", "opening"),
    "parts": ("part", "thickness"),
    "pipe": ("tunnel", "thickness"),
    "shell": ("cavity", "thickness"),
}
"""Which size of which features each family plants."""


def errors_on_mesh(solid: Planted, family: str, finest: float) -> list[float]:
    """Relative errors of the widths of a mesh's planted features from `finest` on."""
    kind, size = MEASURED[family]
    features = tk.from_mesh(np.asarray(solid.mesh.vertices), np.asarray(solid.mesh.faces)).features(finest).features
    found = [getattr(one, size) for one in features if one.kind == kind]
    known = [width for width, _ in solid.features if width > 1.15 * finest]
    return [other / one - 1 for one, other in paired(known, found)]


def paired(first: Sequence[float], second: Sequence[float]) -> list[tuple[float, float]]:
    """Pairs of widths of two lists that differ least, as many as the shorter list has."""
    if not (first and second):
        return []
    cost = np.abs(np.log(np.divide.outer(np.asarray(first), np.asarray(second))))
    return [(first[i], second[j]) for i, j in zip(*linear_sum_assignment(cost), strict=True)]


def against_mesh(solid: Planted, n_points: int, seed: int) -> dict[str, float] | None:
    """How the features of a cloud compare with those of its mesh; None if the cloud has no closed surface."""
    points = torch.from_numpy(trimesh.sample.sample_surface(solid.mesh, n_points, seed=seed)[0].copy())
    cloud = tk.from_points(points)
    report = cloud.report()
    try:
        found = cloud.features(0.75 * float(report.resolution or 0.0))
    except tk.InputError:
        return None
    width = found.finest / 0.75
    wide = tk.from_mesh(np.asarray(solid.mesh.vertices), np.asarray(solid.mesh.faces)).features(width).features
    pairs = [pair for kind in KINDS for pair in paired(_widths(wide, kind), _widths(found.features, kind))]
    ratios = [abs(other / one - 1) for one, other in pairs]
    return {
        "likely": report.verdict == "likely",
        "wide": len(wide),
        "missed": len(wide) - sum(ratio < 0.5 for ratio in ratios),
        "error": float(np.median(ratios)) if ratios else 0.0,
    }


def _widths(features: Sequence[Feature], kind: str) -> list[float]:
    return [one.width for one in features if one.kind == kind]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=6)
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = []
    for family in FAMILIES:
        errors, clouds = [], []
        for seed in range(options.draws):
            solid = planted(family, seed, options.points)
            if family in MEASURED:
                errors += errors_on_mesh(solid, family, float(np.ptp(solid.mesh.vertices, axis=0).max()) * 3 / 128)
            clouds.append(against_mesh(solid, options.points, seed))
        answered = [one for one in clouds if one is not None]
        likely = [one for one in answered if one["likely"]]
        row = {
            "family": family,
            "widths": len(errors),
            "median error": float(np.median(np.abs(errors))) if errors else None,
            "clouds": len(answered),
            "wide": sum(one["wide"] for one in answered),
            "missed": sum(one["missed"] for one in answered),
            "wide in likely": sum(one["wide"] for one in likely),
            "missed in likely": sum(one["missed"] for one in likely),
            "cloud error": float(np.median([one["error"] for one in answered])) if answered else None,
        }
        rows.append(row)
        print(row, flush=True)
    if options.json:
        options.json.write_text(json.dumps(rows))


if __name__ == "__main__":
    main()
