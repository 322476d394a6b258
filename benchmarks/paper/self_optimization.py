"""Convergence of self-optimization: the paper's descent at several rates, and Polyak steps."""

from __future__ import annotations

from benchmarks.paper.shapes import generated, samples
from benchmarks.paper.tables import Options, Table, timed
from topokit.core.local.self_optimization import Refinement, self_optimize
from topokit.core.samples import SurfaceSamples
from topokit.testing import genus_mesh

RATES = (0.01, 0.03, 0.1, 0.3)
STEPS = 40
SHOWN = (0, 1, 2, 5, 10, 20, 40)
TARGET = -4.0  # genus 3


def curves(options: Options) -> dict[str, tuple[Refinement, float]]:
    """Name, result and seconds of each way, on one cloud of genus 3 without normals."""
    points = samples(generated(genus_mesh(3)), 2_000 if options.quick else 10_000, 0)[0]
    start = SurfaceSamples(points)
    found = {"Polyak": timed(lambda: self_optimize(start, TARGET))}
    for rate in RATES[:1] if options.quick else RATES:
        name = f"gradient, rate {rate:g}"
        found[name] = timed(
            lambda rate=rate: self_optimize(start, TARGET, step="gradient", learning_rate=rate, max_steps=STEPS)
        )
    return found


def tables(options: Options) -> list[Table]:
    """χ after some steps."""
    table = Table(f"χ of a cloud of genus 3, target {TARGET:g}", ["way", *(f"step {n}" for n in SHOWN), "CPU s"])
    for name, (found, seconds) in curves(options).items():
        values = found.history.tolist()
        cells = [f"{values[n]:.4f}" if n < len(values) else "–" for n in SHOWN]
        table.add(name, *cells, f"{seconds:.1f}")
    return [table]
