"""Table II: the Euler characteristic of shapes by the paper's estimate, by the report and by other methods."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from statistics import mean, median

import torch
from torch import Tensor

import topokit as tk
from benchmarks.paper import baselines, shapes
from benchmarks.paper.printed import SETTINGS, TABLE_2, ours
from benchmarks.paper.tables import Options, Table, installed, missing, timed
from topokit.core.local.curvature import CurvatureSettings, surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.neighbors import nearest_neighbors
from topokit.core.samples import SurfaceSamples

K_VALUES = (16, 20, 30)
MESHLAB_ROWS = baselines.MESHLAB[1:]  # the three that the paper's Table II has
CLEAN_SEEDS = 1


@dataclass(frozen=True)
class Setting:
    """Number of points, and noise in units of half the longest side."""

    n_points: int
    noise: float


PAPER_SETTINGS = (Setting(5_000, 0.0), Setting(10_000, 0.0), Setting(10_000, 0.025))
REPORTED = PAPER_SETTINGS[1]
EXTRA = Setting(10_000, 0.01)  # 0.5 % of the longest side
Value = float | int | None
Method = Callable[[Tensor, Tensor, int], Value]


def estimate(points: Tensor, normals: Tensor | None, k: int, method: str = "pca") -> float:
    """χ⁽⁰⁾ without the term of a boundary: all shapes here are closed."""
    settings = CurvatureSettings(k, normal_method=method)  # type: ignore[arg-type]
    local = surface_curvature(SurfaceSamples(points, normals), settings)
    return float(euler_characteristic(local.gaussian, local.area))


def refined(points: Tensor, target: float | None) -> float:
    """χ⁽ᴷ⁾ from unoriented points; None takes the witness's integer."""
    return float(tk.from_points(points).refined_euler(target))


def reported(points: Tensor) -> tuple[int | None, str]:
    """The integer and the verdict, without normals."""
    report = tk.from_points(points).report()
    return report.euler, report.verdict


def is_right(value: Value, euler: int) -> bool:
    """Whether the value rounds to χ as the paper rounds: 2·round(χ/2)."""
    return value is not None and math.isfinite(value) and 2 * round(value / 2) == euler


@dataclass
class Score:
    """Values of one method over shapes and seeds, beside the truth."""

    values: list[tuple[Value, int]]
    seconds: list[float]

    def cells(self) -> list[str]:
        known = [(value, euler) for value, euler in self.values if value is not None and math.isfinite(value)]
        errors = [abs(value - euler) for value, euler in known]
        right = sum(is_right(*pair) for pair in self.values)
        near = sum(error < 0.5 for error in errors)
        return [
            f"{right} / {len(self.values)}",
            f"{near} / {len(self.values)}",
            f"{mean(errors):.2f}" if errors else "–",
            f"{median(errors):.2f}" if errors else "–",
            f"{median(self.seconds):.2f}",
        ]


def fast_methods() -> dict[str, Method]:
    """The paper's estimate with the mesh's normals, PCA normals and quadric normals."""
    found: dict[str, Method] = {}
    for k in K_VALUES:
        found[f"χ⁽⁰⁾, mesh normals, k = {k}"] = lambda p, n, _, k=k: estimate(p, n, k)
        found[f"χ⁽⁰⁾, PCA normals, k = {k}"] = lambda p, n, _, k=k: estimate(p, None, k)
    found["χ⁽⁰⁾, quadric normals, k = 20"] = lambda p, n, _: estimate(p, None, 20, "quadric")
    return found


def slow_methods() -> dict[str, Method]:
    """Reports, self-optimization, and the packages that are installed."""
    found: dict[str, Method] = {
        "report(), no normals": lambda p, n, _: reported(p)[0],
        "χ⁽ᴷ⁾, target of the witness": lambda p, n, _: refined(p, None),
        "χ⁽ᴷ⁾, answer given": lambda p, n, euler: refined(p, float(euler)),
    }
    if installed("open3d"):
        found["Poisson mesh, mesh normals: V − E + F"] = lambda p, n, _: _poisson_euler(p, n)
        found["Poisson mesh, no normals: V − E + F"] = lambda p, n, _: _poisson_euler(p, None)
        if installed("pymeshlab"):
            for name in MESHLAB_ROWS:
                found[f"MeshLab {name} on that mesh"] = lambda p, n, _, name=name: _meshlab_euler(p, n, name)
    if installed("gudhi"):
        found["alpha complex"] = lambda p, n, _: baselines.alpha_euler(p)
    return found


def _poisson_euler(points: Tensor, normals: Tensor | None) -> int:
    return baselines.euler_of_mesh(baselines.poisson_mesh(points, normals))


def _meshlab_euler(points: Tensor, normals: Tensor, name: str) -> float:
    mesh = baselines.poisson_mesh(points, normals)
    gaussian, _ = baselines.meshlab_curvature(mesh, name)
    return float((gaussian * baselines.vertex_areas(mesh)).nansum()) / (2 * math.pi)


def row_table(options: Options, rows: list[shapes.Row]) -> Table:
    """The paper's rows: what it prints beside what is found here, from samples alone."""
    table = Table(
        "Rows of Table II: χ⁽⁰⁾ from samples alone, median [range] over seeds",
        [
            "row",
            "χ",
            "measured here",
            "setting",
            "paper",
            "mesh normals, k = 16",
            "20",
            "30",
            "PCA, k = 20",
            "report()",
        ],
    )
    for row in rows:
        if row.make is None:
            table.add(row.name, TABLE_2[row.name][0], f"D: {shapes.CLASSES['D']}", *_printed(row.name))
            continue
        mesh = row.make()
        told = f"{row.kind}: {row.text or shapes.CLASSES[row.kind]}"
        for number, setting in enumerate(_settings(options)):
            table.add(row.name, row.euler, told, *_measured(options, row, mesh, number, setting))
    return table


def _settings(options: Options) -> tuple[Setting, ...]:
    return PAPER_SETTINGS[:1] if options.quick else PAPER_SETTINGS


def _printed(name: str) -> list[str]:
    return ["all", ", ".join(f"{ours(name, setting):.2f}" for setting in range(3)), *["–"] * 5]


def _measured(options: Options, row: shapes.Row, mesh: shapes.Mesh, number: int, setting: Setting) -> list[str]:
    """Cells of one shape in one setting; the report runs on the first draw of one setting, because it takes longer."""
    draws = [shapes.samples(mesh, setting.n_points, seed, setting.noise) for seed in range(options.seeds)]
    largest = max(K_VALUES)
    found: dict[str, list[float]] = {}
    for points, normals in draws:
        neighbors = nearest_neighbors(points, largest)
        for k in K_VALUES:
            found.setdefault(f"mesh {k}", []).append(_with(points, normals, neighbors[:, :k]))
        found.setdefault("PCA", []).append(_with(points, None, neighbors[:, :20]))
    report = "–"
    if setting == REPORTED and not options.quick:
        report = "{} ({})".format(*reported(draws[0][0]))
    return [SETTINGS[number], f"{ours(row.name, number):.2f}", *(_range(one) for one in found.values()), report]


def _with(points: Tensor, normals: Tensor | None, neighbors: Tensor) -> float:
    local = surface_curvature(SurfaceSamples(points, normals), neighbors=neighbors.contiguous())
    return float(euler_characteristic(local.gaussian, local.area))


def _range(values: list[float]) -> str:
    if len(values) == 1:
        return f"{values[0]:.2f}"
    return f"{median(values):.2f} [{min(values):.2f}, {max(values):.2f}]"


def paper_score() -> Table:
    """The paper's own numbers, scored again: by rounding, and by distance."""
    table = Table(
        "The paper's Table II, scored again: 20 rows",
        ["method", "setting", "right by 2·round(χ/2)", "within ½", "mean error", "median error"],
    )
    for column, name in enumerate(("Taubin", "Normal", "Quadric", "Ours")):
        for setting, text in enumerate(SETTINGS):
            pairs = [(found[setting][column], euler) for euler, found in TABLE_2.values()]
            table.add(name, text, *Score(list(pairs), [0.0]).cells()[:4])
    return table


def clean_table(options: Options, title: str, meshes: list[tuple[str, int, shapes.Mesh]], setting: Setting) -> Table:
    """The same methods over many meshes: the table that means something."""
    table = Table(
        f"{title}: {setting.n_points} points"
        + (f", noise of {setting.noise / 2:.1%} of the longest side" if setting.noise else "")
        + f", {CLEAN_SEEDS} seed",
        ["method", "right by 2·round(χ/2)", "within ½", "mean error", "median error", "median seconds"],
    )
    methods = fast_methods() | ({} if options.quick else slow_methods())
    scores = {name: Score([], []) for name in methods}
    for _, euler, mesh in meshes:
        points, normals = shapes.samples(mesh, setting.n_points, 0, setting.noise)
        for name, method in methods.items():
            value, seconds = timed(lambda m=method, p=points, n=normals, e=euler: m(p, n, e))
            scores[name].values.append((value, euler))
            scores[name].seconds.append(seconds)
    for name, score in scores.items():
        table.add(name, *score.cells())
    return table


def tables(options: Options) -> list[Table]:
    """Table II, the paper's numbers scored again, and all clean meshes of the data."""
    torch.manual_seed(0)  # nothing here draws from it, but MeshLab's and Open3D's bindings may
    rows = list(shapes.rows(options.data, options.thingi10k))
    if options.quick:  # meshes of networks take half a minute each
        rows = [row for row in rows if row.kind != "B" and row.name != "Bunny"]
    found = [row_table(options, rows), paper_score()]
    if options.only_rows:
        return found
    if options.data is None:
        found[0].notes.append(
            "Without --data the rows that need its files, and the table of clean meshes, are left out."
        )
        known = [(row.name, row.euler, row.make()) for row in rows if row.make is not None]
        found.append(clean_table(options, "Shapes made by topokit.testing", known, Setting(5_000, 0.0)))
    else:
        clean = shapes.clean_meshes(options.data)[:: 8 if options.quick else options.every]
        meshes = [(name, euler, shapes.read(path)) for name, euler, path in clean]
        for setting in PAPER_SETTINGS[1:2] if options.quick else (PAPER_SETTINGS[1], EXTRA):
            found.append(clean_table(options, f"All {len(meshes)} clean meshes", meshes, setting))
    for package in ("pymeshlab", "open3d", "gudhi"):
        if not installed(package):
            found[-1].notes.append(missing(package, "its methods"))
    return found
