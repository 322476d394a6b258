"""Table I: errors of curvature on sphere, ellipsoid and torus."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from benchmarks.paper.baselines import MESHLAB, jet_curvature, meshlab_curvature, parameter_mesh, vertex_areas
from benchmarks.paper.printed import TABLE_1
from benchmarks.paper.surfaces import COLUMNS, Column
from benchmarks.paper.tables import Options, Table, installed, missing, spread, timed
from topokit.core.local.curvature import CurvatureSettings, surface_curvature
from topokit.core.neighbors import nearest_neighbors
from topokit.core.samples import SurfaceSamples
from topokit.testing import AnalyticSamples

K = 30
FEW = 20_000  # points from which all but two rows have one seed
PAPER_NAMES = dict(zip(MESHLAB, ("PCA", "Taubin", "Normal", "Quadric"), strict=True))


@dataclass(frozen=True)
class Found:
    """K and H at every point, with the signs of H right, their integral and the time it took."""

    gaussian: Tensor
    mean: Tensor
    euler: float
    seconds: float


def logs(errors: Tensor) -> tuple[float, float, float]:
    """log₁₀ of maximum, mean and median; values that are not finite count as the largest that are."""
    errors = errors.nan_to_num(nan=1e300, posinf=1e300)
    return tuple(math.log10(max(float(one), 1e-300)) for one in (errors.max(), errors.mean(), errors.median()))  # type: ignore[return-value]


def estimated(known: AnalyticSamples, points: Tensor, k: int, normals: str) -> Found:
    """topokit's estimate with normals that are "given", or estimated by "pca" or "quadric"."""
    settings = CurvatureSettings(k, normal_method="quadric" if normals == "quadric" else "pca")
    samples = SurfaceSamples(points, known.normals if normals == "given" else None)
    local, seconds = timed(lambda: surface_curvature(samples, settings))
    sign = torch.where((local.normals * known.normals).sum(-1) < 0, -1.0, 1.0)
    euler = float((local.gaussian * local.area).sum()) / (2 * math.pi)
    return Found(local.gaussian, sign * local.mean, euler, seconds)


def fitted(known: AnalyticSamples, points: Tensor, k: int) -> Found:
    """Quadric fits; the areas of the sum are topokit's."""
    neighbors = nearest_neighbors(points, k)
    (gaussian, mean, normals), seconds = timed(lambda: jet_curvature(points, neighbors))
    sign = torch.where((normals * known.normals).sum(-1) < 0, -1.0, 1.0)
    area = surface_curvature(SurfaceSamples(points), CurvatureSettings(k), neighbors=neighbors).area
    return Found(gaussian, sign * mean, float((gaussian * area).sum()) / (2 * math.pi), seconds)


def by_meshlab(column: Column, known: AnalyticSamples, points: Tensor, filter_name: str) -> Found:
    """One of MeshLab's filters on the Delaunay mesh of the parameters, the best mesh of these points."""
    mesh = parameter_mesh(column, known.points, points)
    (gaussian, mean), seconds = timed(lambda: meshlab_curvature(mesh, filter_name))
    sign = torch.where(mean * known.mean < 0, -1.0, 1.0) if (mean * known.mean).median() < 0 else 1.0
    euler = float((gaussian * vertex_areas(mesh)).sum()) / (2 * math.pi)
    return Found(gaussian, sign * mean, euler, seconds)


def zero(known: AnalyticSamples) -> Found:
    """What estimating nothing costs."""
    nothing = torch.zeros_like(known.gaussian)
    return Found(nothing, nothing, 0.0, 0.0)


Method = tuple[str, str | None, Callable[[AnalyticSamples, Tensor], Found]]


def methods(column: Column, k_values: tuple[int, ...]) -> Iterator[Method]:
    """Name, row of the paper, and how to compute it."""
    for k in k_values:
        yield f"given normals, k = {k}", "Our" if k == K else None, lambda a, b, k=k: estimated(a, b, k, "given")
        yield f"PCA normals, k = {k}", "Our" if k == K else None, lambda a, b, k=k: estimated(a, b, k, "pca")
    yield f"quadric normals, k = {K}", None, lambda a, b: estimated(a, b, K, "quadric")
    yield f"quadric (jet) fit, k = {K}", None, lambda a, b: fitted(a, b, K)
    yield "zero", None, lambda a, b: zero(a)
    if installed("pymeshlab"):
        for one in MESHLAB:
            yield f"MeshLab {one}", PAPER_NAMES[one], lambda a, b, one=one: by_meshlab(column, a, b, one)


def column_table(name: str, options: Options, by_area: bool = False, share: float = 1.0) -> Table:
    """All methods on one column."""
    column = COLUMNS[name]
    where = "by area" if by_area else "in both angles"
    table = Table(
        f"Column {name}: {column.text}, {round(share * column.n_points)} points uniform {where}",
        ["method", "K max", "K mean", "K median", "H max", "H mean", "χ", "CPU s", "paper: K max, mean", "H", "χ"],
    )
    is_large = column.n_points > FEW
    k_values = (K,) if by_area or is_large or options.quick else (K, 20, 50)
    for title, printed, method in methods(column, k_values):
        has_all = not is_large or (printed == "Our" and column.noise_share == 0)
        found = []
        for seed in range(options.seeds if has_all else 1):
            known, points = column.samples(seed, by_area, share)
            one = method(known, points)
            errors = (one.gaussian - known.gaussian).abs(), (one.mean - known.mean).abs()
            found.append((*logs(errors[0]), *logs(errors[1])[:2], one.euler, one.seconds))
        k_max, k_mean, k_median, h_max, h_mean, euler, seconds = zip(*found, strict=True)
        paper = TABLE_1[printed].get(name) if printed and not by_area else None
        told = [f"{p:.3f}, {q:.3f}" for p, q in paper[:2]] + [f"{paper[2]:g}"] if paper else ["–"] * 3
        cells = (f"{max(k_max):.2f}", spread(k_mean), spread(k_median), f"{max(h_max):.2f}", spread(h_mean))
        table.add(title, *cells, spread(euler), f"{sorted(seconds)[len(seconds) // 2]:.2f}", *told)
    return table


def tables(options: Options) -> list[Table]:
    """Table I, one table for each column, and columns B and D with points uniform by area."""
    share = 0.05 if options.quick else 1.0
    found = [column_table(name, options, share=share) for name in COLUMNS]
    found += [column_table(name, options, by_area=True, share=share) for name in ("B", "D")]
    found[0].notes.append(
        "Errors are log₁₀: the largest over all seeds, mean ± standard deviation of the others. H has the sign of the "
        "outward normal. The mesh for MeshLab's filters is the Delaunay mesh of the surface's parameters with its "
        "vertices at the points. Columns E and F: all seeds for the two rows of k = 30 with given and PCA normals, one "
        "for the others and for F′."
    )
    if not installed("pymeshlab"):
        found[0].notes.append(missing("pymeshlab", "MeshLab's filters"))
    return found
