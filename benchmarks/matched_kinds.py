"""A solid compared with itself in other representations: is every feature matched that is wider than what both resolve?

    python benchmarks/matched_kinds.py [--draws 1] [--families shell pipe …] [--points 10000] [--out FILE]

Solids of `planted.py`, as meshes, against their own samples without normals, their splats, a function that interpolates
their signed distance, and a binary volume, each on common grids of two resolutions. Counted are the parts, tunnels and
cavities of the mesh that `features()` finds to be wider than a multiple of what is resolved: of two steps of the common
grid, the resolution that the report of samples or splats states, or two steps of the function or volume, the coarsest
of them. No cluster of splats is dropped as a floater. Wide features of one kind in one pair are all matched if at least
as many match.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path

import numpy as np
import torch
import trimesh
from planted import FAMILIES, planted
from splat_scenes import Style, discs_on

import topokit as tk
from topokit.core.scale.signed_distance import SignedDistance, signed_distance
from topokit.core.surface import TriangleSurface

GRIDS = (64, 128)  # cells of the common grid along the longest side
CELLS = 60  # of the function and the volume along the longest side of the solid
FACTORS = (1.0, 1.5)  # widths that are counted, in what is resolved
NAMES = ("parts", "tunnels", "cavities")


def interpolated(distance: SignedDistance):
    """A function of points (N, 3), and the corners of the box in which it is given."""
    values = torch.from_numpy(np.ascontiguousarray(distance.values, dtype=np.float32))
    low = torch.from_numpy(distance.low).float()
    size = torch.tensor(values.shape) - 1

    def at(points: torch.Tensor) -> torch.Tensor:
        places = 2 * (points.float() - low) / distance.cell / size - 1
        found = torch.nn.functional.grid_sample(
            values[None, None], places.flip(-1)[None, :, None, None], align_corners=True, padding_mode="border"
        )
        return found.reshape(-1).to(points.dtype)

    corners = distance.low, distance.low + distance.cell * size.numpy()
    return at, tuple(map(tuple, corners))


def kinds_of(mesh: trimesh.Trimesh, n_points: int, seed: int):
    """Name, shape, and width that it resolves, of each representation."""
    points = trimesh.sample.sample_surface(mesh, n_points, seed=seed)[0].copy()
    splats = discs_on(mesh, n_points, Style(), np.random.default_rng(seed))
    for name, shape in (
        ("samples", tk.from_points(points)),
        ("splats", tk.from_splats(splats, min_cluster_share=None)),
    ):
        yield name, shape, shape.report().resolution
    cell = float(np.ptp(mesh.vertices, axis=0).max()) / CELLS
    surface = TriangleSurface(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64))
    distance = signed_distance(surface, cell)
    function, bounds = interpolated(distance)
    yield "function", tk.from_sdf(function, bounds=bounds, resolution=128), 2 * cell
    origin = tuple(distance.low.tolist())
    yield "volume", tk.from_voxels(distance.values < 0, spacing=cell, origin=origin), 2 * cell


def compared(family: str, seed: int, n_points: int):
    """A record for each representation and grid."""
    mesh = planted(family, seed, n_points).mesh
    truth = tk.from_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    features = truth.features(float(np.ptp(mesh.vertices, axis=0).max()) / CELLS)
    for name, shape, resolved in kinds_of(mesh, n_points, seed):
        for cells in GRIDS:
            record = {"family": family, "seed": seed, "kind": name, "cells": cells}
            try:
                found = shape.compare(truth, resolution=cells)
            except tk.InputError as error:
                yield record | {"error": str(error)}
                continue
            least = max(resolved, 2 * found.resolution, features.finest)
            wide = {str(factor): [*features.above(factor * least)] for factor in FACTORS}
            yield record | {"resolved": least, "matched": [*found.matched], "wide": wide}


def table(records: list[dict]) -> str:
    """Matched of the wide features, by representation, grid and factor."""
    lines = []
    for kind in dict.fromkeys(one["kind"] for one in records):
        for cells in GRIDS:
            own = [one for one in records if (one["kind"], one["cells"]) == (kind, cells)]
            done = [one for one in own if "error" not in one]
            shares = []
            for factor in map(str, FACTORS):
                n_wide, n_matched = Counter(), Counter()
                for one, (k, name) in ((one, pair) for one in done for pair in enumerate(NAMES)):
                    n_wide[name] += one["wide"][factor][k]
                    n_matched[name] += min(one["wide"][factor][k], one["matched"][k])
                shares.append(f"{sum(n_matched.values())} of {sum(n_wide.values())}")
            lines.append(f"| {kind} | {cells} | {len(done)} of {len(own)} | {' | '.join(shares)} |")
    head = (
        "| against the mesh | cells | closed | " + " | ".join(f"wider than {factor:g} ×" for factor in FACTORS) + " |"
    )
    return "\n".join([head, "|---" * (3 + len(FACTORS)) + "|", *lines])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=1)
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--families", nargs="*", default=[*FAMILIES])
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    records = []
    for seed in range(options.draws):
        for family in options.families:
            for record in compared(family, seed, options.points):
                records.append(record)
                if options.out is not None:
                    with options.out.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(record) + "\n")
    print(table(records))


if __name__ == "__main__":
    main()
