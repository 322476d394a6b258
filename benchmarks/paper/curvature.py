"""Table I: errors of curvature on sphere, ellipsoid and torus."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from benchmarks.paper.baselines import MESHLAB, jet_curvature, meshlab_curvature, parameter_mesh
from benchmarks.paper.curvature_errors import HEADER, Found, cells, integral, outward
from benchmarks.paper.estimates import curvature_with, euler_of
from benchmarks.paper.printed import PAPER_NAMES
from benchmarks.paper.reconstructed import reconstructed_table
from benchmarks.paper.surfaces import COLUMNS, FEW, Column
from benchmarks.paper.tables import Options, Table, installed, missing, timed
from topokit.core.local.curvature import CurvatureSettings
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.neighbors import nearest_neighbors
from topokit.testing import AnalyticSamples

K = 30


@dataclass(frozen=True)
class Method:
    """One row of the tables.

    Attributes:
        title: what it is.
        run: from the surface at the points, and the points with noise.
        printed: its row in the paper.
        is_slow: whether its time grows with the square of the number of points.
    """

    title: str
    run: Callable[[AnalyticSamples, Tensor], Found]
    printed: str | None = None
    is_slow: bool = False


def estimated(known: AnalyticSamples, points: Tensor, k: int, normals: str) -> Found:
    """topokit's estimate with normals of one of the kinds of `estimates.NORMALS`."""
    local, seconds = timed(lambda: curvature_with(normals, points, known.normals, CurvatureSettings(k)))
    sign = torch.where((local.normals * known.normals).sum(-1) < 0, -1.0, 1.0)
    return Found(local.gaussian, sign * local.mean, euler_of(local), seconds)


def fitted(known: AnalyticSamples, points: Tensor, k: int) -> Found:
    """Quadric fits; the areas of the sum are topokit's."""
    neighbors = nearest_neighbors(points, k)
    (gaussian, mean, normals), seconds = timed(lambda: jet_curvature(points, neighbors))
    sign = torch.where((normals * known.normals).sum(-1) < 0, -1.0, 1.0)
    area = curvature_with("pca", points, known.normals, CurvatureSettings(k), neighbors).area
    return Found(gaussian, sign * mean, float(euler_characteristic(gaussian, area)), seconds)


def by_meshlab(column: Column, known: AnalyticSamples, points: Tensor, filter_name: str) -> Found:
    """One of MeshLab's filters on the Delaunay mesh of the parameters, the best mesh of these points."""
    mesh = parameter_mesh(column, known.points, points)
    curvature, seconds = timed(lambda: meshlab_curvature(mesh, filter_name))
    assert curvature is not None, "MeshLab refused the mesh of a sphere or torus"
    gaussian, mean = curvature
    return Found(gaussian, outward(mean, known), integral(gaussian, mesh), seconds)


def zero(known: AnalyticSamples) -> Found:
    """What estimating nothing costs."""
    nothing = torch.zeros_like(known.gaussian)
    return Found(nothing, nothing, 0.0, 0.0)


def methods(column: Column, k_values: tuple[int, ...]) -> Iterator[Method]:
    """All rows of a column's table."""
    for k in k_values:
        ours = "Our" if k == K else None
        yield Method(f"given normals, k = {k}", lambda a, b, k=k: estimated(a, b, k, "given"), ours)
        yield Method(f"PCA normals, k = {k}", lambda a, b, k=k: estimated(a, b, k, "pca"), ours)
    yield Method(f"quadric normals, k = {K}", lambda a, b: estimated(a, b, K, "quadric"))
    yield Method(f"quadric (jet) fit, k = {K}", lambda a, b: fitted(a, b, K))
    yield Method("zero", lambda a, b: zero(a))
    if installed("pymeshlab"):
        for one in MESHLAB:
            run = lambda a, b, one=one: by_meshlab(column, a, b, one)  # noqa: E731
            yield Method(f"MeshLab {one}", run, PAPER_NAMES[one], one == MESHLAB[0])


def column_table(name: str, options: Options, by_area: bool = False) -> Table:
    """All methods on one column."""
    column = COLUMNS[name]
    share = 0.05 if options.quick else 1.0
    where = "by area" if by_area else "in both angles"
    table = Table(
        f"Column {name}: {column.text}, {round(share * column.n_points)} points uniform {where}", ["method", *HEADER]
    )
    is_large = column.n_points > FEW
    k_values = (K,) if by_area or is_large or options.quick else (K, 20, 50)
    for method in methods(column, k_values):
        is_single = is_large and method.is_slow
        draws = [column.samples(seed, by_area, share) for seed in range(1 if is_single else options.seeds)]
        found = [(known, method.run(known, points)) for known, points in draws]
        title = method.title + ", one draw" * (is_single and options.seeds > 1)
        table.add(title, *cells(found, None if by_area or method.printed is None else (method.printed, name)))
    return table


NOTE = """\
Errors are log₁₀: the largest over all seeds, mean ± standard deviation of the others. H has the sign of the outward \
normal. The mesh for MeshLab's filters is the Delaunay mesh of the surface's parameters, its vertices at the points."""
PARTS = (*COLUMNS, "by-area", "reconstructed")


def tables(options: Options) -> list[Table]:
    """Table I, one table for each column; columns B and D with points uniform by area; reconstructed meshes."""
    wanted = PARTS if options.part == "all" else (options.part,)
    found = [column_table(name, options) for name in COLUMNS if name in wanted]
    if "by-area" in wanted:
        found += [column_table(name, options, by_area=True) for name in ("B", "D")]
    if found:
        found[0].notes.append(NOTE)
        found[0].notes += [] if installed("pymeshlab") else [missing("pymeshlab", "MeshLab's filters")]
    return [*found, *([reconstructed_table(options)] if "reconstructed" in wanted else [])]
