"""Persistent homology and topokit on the same clouds: seconds, simplices, bars and χ."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

import topokit as tk
from benchmarks.paper.baselines import alpha_bars, longest_plateau, plateaus
from benchmarks.paper.shapes import Mesh, generated, read, samples
from benchmarks.paper.tables import Options, Table, installed, missing, timed
from topokit.testing import genus_mesh

EDGES = (0.08, 0.1, 0.15)  # limits of the Rips complex in [−1, 1]³
RIPSER_POINTS = 1_000  # ripser without a limit is quadratic in memory
SHOWN = 6  # longest bars


def clouds(options: Options) -> Iterator[tuple[str, int, Tensor]]:
    """Name, χ and points; the paper's 7 000."""
    n = 1_000 if options.quick else 7_000
    shapes: list[tuple[str, int, Mesh]] = [("genus 3, made", -4, generated(genus_mesh(3)))]
    if options.data is not None:
        shapes.insert(0, ("Kitten", 0, read(options.data / "meshes" / "paper_Kitten.obj")))
    for name, euler, mesh in shapes:
        yield name, euler, samples(mesh, n, 0)[0]


def longest(bars: np.ndarray) -> str:
    """Lengths of the longest bars; ∞ for those that are alive where the complex ends."""
    lengths = np.sort(bars[:, 1] - bars[:, 0])[::-1]
    return ", ".join(f"{length:.3f}" if np.isfinite(length) else "∞" for length in lengths[:SHOWN])


def rips(points: Tensor, limit: float) -> tuple[int, np.ndarray]:
    """Number of simplices and bars of dimension 1 of the Rips complex up to triangles."""
    import gudhi

    tree = gudhi.RipsComplex(points=points.numpy(), max_edge_length=limit).create_simplex_tree(max_dimension=2)
    tree.compute_persistence()
    return tree.num_simplices(), tree.persistence_intervals_in_dimension(1)


def tables(options: Options) -> list[Table]:
    """One table for each cloud."""
    found = []
    for name, euler, points in clouds(options):
        table = Table(
            f"{name}, χ = {euler}: {len(points)} points",
            ["method", "CPU s", "simplices", f"the {SHOWN} longest bars of dimension 1", "χ"],
        )
        value, seconds = timed(lambda points=points: float(tk.from_points(points).gauss_bonnet(20)))
        table.add("topokit χ⁽⁰⁾", f"{seconds:.2f}", "–", "–", f"{value:.2f}")
        report, seconds = timed(lambda points=points: tk.from_points(points).report())
        table.add("topokit report()", f"{seconds:.2f}", "–", "–", f"{report.euler} ({report.verdict})")
        if installed("gudhi"):
            (simplices, alpha), seconds = timed(lambda points=points: alpha_bars(points))
            held = longest_plateau(plateaus(points, alpha))
            table.add("gudhi, alpha complex", f"{seconds:.2f}", simplices, longest(alpha[1]), held)
            for limit in EDGES[:1] if options.quick else EDGES:
                (simplices, bars), seconds = timed(lambda p=points, edge=limit: rips(p, edge))
                table.add(f"gudhi, Rips, edges ≤ {limit}", f"{seconds:.2f}", simplices, longest(bars), "–")
        else:
            table.notes.append(missing("gudhi", "persistence"))
        if installed("ripser"):
            import ripser

            few = points[torch.arange(0, len(points), max(1, len(points) // RIPSER_POINTS))]
            diagrams, seconds = timed(lambda few=few: ripser.ripser(few.numpy(), maxdim=1, thresh=1.0))
            table.add(f"ripser, {len(few)} of the points", f"{seconds:.2f}", "–", longest(diagrams["dgms"][1]), "–")
        else:
            table.notes.append(missing("ripser", "ripser"))
        found.append(table)
    return found
