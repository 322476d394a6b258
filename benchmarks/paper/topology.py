"""Table II: the Euler characteristic of shapes by the paper's estimate, by the report and by other methods."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean, median

import torch
from torch import Tensor

import topokit as tk
from benchmarks.paper import shapes
from benchmarks.paper.clean_meshes import clean_table
from benchmarks.paper.printed import SETTINGS, TABLE_2, ours
from benchmarks.paper.scores import Setting, Value, errors, is_right, near
from benchmarks.paper.tables import Options, Table, installed, missing, seeds_text
from topokit.core.local.curvature import CurvatureSettings, NormalMethod, surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.neighbors import nearest_neighbors
from topokit.core.samples import SurfaceSamples

K_VALUES = (16, 20, 30)
PAPER_SETTINGS = (Setting(5_000), Setting(10_000), Setting(10_000, 0.025))
REPORTED = PAPER_SETTINGS[1]
NOISY = Setting(10_000, 0.01)  # 0.5 % of the longest side
METHODS = (*(f"true normals, k = {k}" for k in K_VALUES), "PCA, k = 20", "quadric, k = 20", "report()")


@dataclass(frozen=True)
class Answers:
    """What each of `METHODS` says of one shape in one setting, for each draw; the report's verdicts."""

    values: dict[str, list[Value]]
    verdicts: list[str]


def answers(mesh: shapes.Mesh, setting: Setting, options: Options) -> Answers:
    """The paper's estimate on each draw; in one setting the report, too, unless the run is quick."""
    values: dict[str, list[Value]] = {name: [] for name in METHODS}
    verdicts = []
    for seed in range(options.seeds):
        points, normals = shapes.samples(mesh, setting.n_points, seed, setting.noise)
        neighbors = nearest_neighbors(points, max(K_VALUES))
        for name, k in zip(METHODS, K_VALUES, strict=False):
            values[name].append(_euler(points, normals, neighbors[:, :k]))
        values["PCA, k = 20"].append(_euler(points, None, neighbors[:, :20]))
        values["quadric, k = 20"].append(_euler(points, None, neighbors[:, :20], "quadric"))
        if setting == REPORTED and not options.quick:
            report = tk.from_points(points).report()
            values["report()"].append(report.euler)
            verdicts.append(report.verdict)
    return Answers(values, verdicts)


def _euler(points: Tensor, normals: Tensor | None, neighbors: Tensor, method: NormalMethod = "pca") -> float:
    settings = CurvatureSettings(normal_method=method)
    local = surface_curvature(SurfaceSamples(points, normals), settings, neighbors=neighbors.contiguous())
    return float(euler_characteristic(local.gaussian, local.area))


def row_tables(options: Options, rows: Sequence[shapes.Row]) -> list[Table]:
    """The paper's rows: what it prints beside what is found here, from samples alone; and both scored alike."""
    table = Table(
        f"Rows of Table II: χ from samples alone, median [range] over {seeds_text(options)}",
        ["row", "χ", "measured here", "setting", "paper", *METHODS],
    )
    measured: list[list[tuple[str, int, Answers]]] = [[] for _ in PAPER_SETTINGS]
    for row in rows:
        if row.make is None:
            printed = ", ".join(f"{ours(row.name, setting):.2f}" for setting in range(3))
            nothing = ["–"] * len(METHODS)
            table.add(row.name, TABLE_2[row.name][0], f"D: {shapes.CLASSES['D']}", "all", printed, *nothing)
            continue
        mesh = row.make()
        euler = tk.from_mesh(mesh).report().euler  # counted: a network's level set need not be its model's
        assert euler is not None
        told = f"{row.kind}: {row.text or shapes.CLASSES[row.kind]}"
        for number, setting in enumerate(PAPER_SETTINGS[:1] if options.quick else PAPER_SETTINGS):
            found = answers(mesh, setting, options)
            measured[number].append((row.name, euler, found))
            cells = [_range(found.values[name]) for name in METHODS[:-1]]
            printed = f"{ours(row.name, number):.2f}"
            table.add(row.name, euler, told, SETTINGS[number], printed, *cells, _integers(found))
    return [table, _score(measured)]


def _range(values: list[Value]) -> str:
    known = [value for value in values if value is not None]
    if len(known) == 1:
        return f"{known[0]:.2f}"
    return f"{median(known):.2f} [{min(known):.2f}, {max(known):.2f}]"


def _integers(found: Answers) -> str:
    """Each integer with the number of draws that gave it, and how many of all were "likely"."""
    counted = Counter(found.values["report()"]).most_common()
    likely = found.verdicts.count("likely")
    return ", ".join(f"{value} ×{n}" for value, n in counted) + (f"; {likely} likely" if counted else "–")


def _score(measured: list[list[tuple[str, int, Answers]]]) -> Table:
    """Shares of draws that are right, and the paper's printed values of the same rows, which are one draw each."""
    names = list(dict.fromkeys(name for found in measured for name, _, _ in found))
    table = Table(
        f"The measured rows scored, all draws: {', '.join(names)}",
        ["setting", "method", "right by 2·round(χ/2)", "within ½", "mean error", "median error"],
    )
    for number, found in enumerate(measured):
        same = {name: euler for name, euler, _ in found if TABLE_2[name][0] == euler}
        printed: list[tuple[Value, int]] = [(ours(name, number), euler) for name, euler in same.items()]
        if printed:
            table.add(SETTINGS[number], "the paper's numbers, rows of the same χ", *_share(printed))
        for method in METHODS:
            pairs = [(value, euler) for _, euler, one in found for value in one.values[method]]
            if pairs:
                table.add(SETTINGS[number], method, *_share(pairs))
    return table


def _share(pairs: list[tuple[Value, int]]) -> list[str]:
    """Right, near, mean and median error."""
    found = errors(pairs)
    right = sum(is_right(*pair) for pair in pairs)
    ends = [f"{mean(found):.2f}", f"{median(found):.2f}"] if found else ["–", "–"]
    return [f"{right} / {len(pairs)}", f"{near(pairs)} / {len(pairs)}", *ends]


def paper_score() -> Table:
    """The paper's own numbers, scored again: by rounding, and by distance."""
    table = Table(
        "The paper's Table II, scored again: 20 rows",
        ["method", "setting", "right by 2·round(χ/2)", "within ½", "mean error", "median error"],
    )
    for column, name in enumerate(("Taubin", "Normal", "Quadric", "Ours")):
        for setting, text in enumerate(SETTINGS):
            table.add(name, text, *_share([(found[setting][column], euler) for euler, found in TABLE_2.values()]))
    return table


PARTS = ("rows", "clean", "noisy")


def tables(options: Options) -> list[Table]:
    """Table II, the paper's numbers scored again, and all clean meshes of the data."""
    torch.manual_seed(0)  # nothing here draws from it, but MeshLab's and Open3D's bindings may
    rows = list(shapes.rows(options.data, options.thingi10k))
    if options.rows:
        rows = sorted((row for row in rows if row.name in options.rows), key=lambda row: options.rows.index(row.name))
    if options.quick:  # meshes of networks take half a minute each
        rows = [row for row in rows if row.kind != "B" and row.name != "Bunny"]
    found = [] if options.part in ("clean", "noisy") else [*row_tables(options, rows), paper_score()]
    if options.part == "rows":
        return found
    if options.data is None:
        known = [(row.name, row.euler, row.make()) for row in rows if row.make is not None]
        found.append(clean_table("Shapes made by topokit.testing", known, PAPER_SETTINGS[0], options.quick))
        found[-1].notes.append(
            "Without --data the rows that need its files, and the table of clean meshes, are left out."
        )
    else:
        clean = shapes.clean_meshes(options.data)[:: 8 if options.quick else options.every]
        meshes = [(name, euler, shapes.read(path)) for name, euler, path in clean]
        title = f"{len(meshes)} clean meshes"
        if options.part != "noisy":
            found.append(clean_table(title, meshes, PAPER_SETTINGS[1], options.quick))
        if options.part != "clean" and not options.quick:
            found.append(clean_table(title, meshes, NOISY, options.quick))
    for package in ("pymeshlab", "open3d", "gudhi"):
        if not installed(package):
            found[-1].notes.append(missing(package, "its methods"))
    return found
