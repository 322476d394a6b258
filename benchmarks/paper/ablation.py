"""The ablation that the paper announces: solver, area, normals and self-optimization."""

from __future__ import annotations

from statistics import median

from torch import Tensor

from benchmarks.paper.curvature import K
from benchmarks.paper.curvature_errors import logs
from benchmarks.paper.estimates import NORMALS, curvature_with, euler_of
from benchmarks.paper.shapes import rows, samples
from benchmarks.paper.surfaces import COLUMNS
from benchmarks.paper.tables import Options, Table, spread
from topokit.core.local.curvature import CurvatureSettings, surface_curvature
from topokit.core.local.self_optimization import self_optimize
from topokit.core.local.weingarten import SOLVERS
from topokit.core.neighbors import nearest_neighbors
from topokit.core.samples import SurfaceSamples
from topokit.testing import AnalyticSamples

AREAS = {"exact": ("exact", 32), "Monte Carlo, W = 32": ("monte-carlo", 32), "Monte Carlo, W = 64": ("monte-carlo", 64)}
SHAPES = ("Icosphere", "Kitten", "Genus6surface")


def draw(name: str, options: Options, seed: int = 0) -> tuple[AnalyticSamples, Tensor, Tensor]:
    """Surface, points and neighbors of a column of Table I."""
    share = 0.05 if options.quick else 10_000 / COLUMNS[name].n_points
    known, points = COLUMNS[name].samples(seed, share=min(share, 1.0))
    return known, points, nearest_neighbors(points, K)


def solver_table(options: Options) -> Table:
    """Mean error of K and χ for each solver and kind of normals."""
    table = Table(
        f"Solvers: log₁₀ of the mean error of K, and χ; at most 10 000 points, k = {K}, seeds: {options.seeds}",
        ["column", "normals", *SOLVERS],
    )
    for name in ("B", "D", "E"):
        clouds = [draw(name, options, seed) for seed in range(options.seeds)]
        for kind in NORMALS:
            cells = []
            for solver in SOLVERS:
                found = [
                    (known, curvature_with(kind, points, known.normals, CurvatureSettings(K, solver), index))
                    for known, points, index in clouds
                ]
                means = [logs((local.gaussian - known.gaussian).abs())[1] for known, local in found]
                cells.append(f"{spread(means)}; {median(euler_of(local) for _, local in found):.2f}")
            table.add(name, kind, *cells)
    return table


def area_table(options: Options) -> Table:
    """χ and the sum of the areas over the true area, for each way to the area."""
    table = Table(f"Areas: χ; Σ A over the true area; given normals, k = {K}, one draw", ["column", *AREAS])
    for name in ("B", "D", "E"):
        known, points, index = draw(name, options)
        cells = []
        for method, resolution in AREAS.values():
            settings = CurvatureSettings(K, "sylvester", method, resolution)  # type: ignore[arg-type]
            local = curvature_with("given", points, known.normals, settings, index)
            cells.append(f"{euler_of(local):.3f}; {float(local.area.sum()) / known.area:.3f}")
        table.add(name, *cells)
    return table


def optimization_table(options: Options) -> Table:
    """Errors before and after self-optimization to the true χ."""
    table = Table(
        "Self-optimization to the true χ: χ, and log₁₀ of the mean error of K, before → after; PCA normals, "
        f"k = {K}, one draw",
        ["column", "χ", "error of K"],
    )
    settings = CurvatureSettings(K, normal_method="pca")
    for name in ("B", "D", "E"):
        known, points, index = draw(name, options)
        start = SurfaceSamples(points)
        found = self_optimize(start, float(known.euler), settings=settings, neighbors=index)
        locals_ = [surface_curvature(one, settings, neighbors=index) for one in (start, found.samples)]
        before, after = (logs((local.gaussian - known.gaussian).abs())[1] for local in locals_)
        table.add(
            name, f"{float(found.history[0]):.3f} → {float(found.history[-1]):.4f}", f"{before:.3f} → {after:.3f}"
        )
    return table


def shape_table(options: Options) -> Table:
    """χ⁽⁰⁾ of the shapes whose files are at hand, for each solver and kind of normals."""
    n = 2_000 if options.quick else 10_000
    table = Table(f"χ⁽⁰⁾ of shapes: {n} points, k = {K}", ["shape", "χ", "normals", *SOLVERS])
    for row in rows(options.data, None):
        if row.name not in SHAPES or row.make is None:
            continue
        points, normals = samples(row.make(), n, 0)
        index = nearest_neighbors(points, K)
        for kind in NORMALS:
            settings = [CurvatureSettings(K, solver) for solver in SOLVERS]
            values = [euler_of(curvature_with(kind, points, normals, one, index)) for one in settings]
            table.add(row.name, row.euler, kind, *(f"{value:.2f}" for value in values))
    return table


def tables(options: Options) -> list[Table]:
    """Solvers, areas, self-optimization, and shapes."""
    return [solver_table(options), area_table(options), optimization_table(options), shape_table(options)]
