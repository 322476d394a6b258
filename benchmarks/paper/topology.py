"""Table II: the Euler characteristic of shapes by the paper's estimate, by the report and by other methods."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean, median

import torch

import topokit as tk
from benchmarks.paper import shapes
from benchmarks.paper.clean_meshes import clean_table
from benchmarks.paper.estimates import estimate
from benchmarks.paper.printed import SETTINGS, TABLE_2, ours
from benchmarks.paper.scores import ROW_SETTINGS, Setting, Value, errors, is_right, near
from benchmarks.paper.tables import Options, Table, installed, missing, seeds_text
from topokit.core.neighbors import nearest_neighbors

K_VALUES = (16, 20, 30)
REPORTED, NOISY = "10 k", "10 k, noise 0.01"  # 0.5 % of the longest side
ESTIMATES = {
    **{f"true normals, k = {k}": ("given", k) for k in K_VALUES},
    "PCA, k = 20": ("pca", 20),
    "quadric, k = 20": ("quadric", 20),
}
METHODS = (*ESTIMATES, "report()")


@dataclass(frozen=True)
class Answers:
    """What each of `METHODS` says of one shape in one setting, for each draw; the report's verdicts."""

    values: dict[str, list[Value]]
    verdicts: list[str]


Measured = dict[str, list[tuple[str, int, Answers]]]
"""For each setting the name of each row, χ of what was measured, and the answers."""


def answers(mesh: shapes.Mesh, setting: Setting, seeds: int, has_report: bool, with_vertices: bool) -> Answers:
    """The paper's estimate, and the report if it is wanted, on each draw."""
    values: dict[str, list[Value]] = {name: [] for name in METHODS}
    verdicts = []
    for seed in range(seeds):
        points, normals = shapes.samples(mesh, setting.n_points, seed, setting.noise, with_vertices)
        neighbors = nearest_neighbors(points, max(K_VALUES))
        for name, (kind, k) in ESTIMATES.items():
            values[name].append(estimate(kind, points, normals, k, neighbors))
        if has_report:
            report = tk.from_points(points).report()
            values["report()"].append(report.euler)
            verdicts.append(report.verdict)
    return Answers(values, verdicts)


def row_table(options: Options, rows: Sequence[shapes.Row], with_vertices: bool = False) -> tuple[Table, Measured]:
    """The paper's rows: what it prints beside what is found here, from samples alone or with all vertices added."""
    what = "samples and all vertices" if with_vertices else "samples alone"
    table = Table(
        f"Rows of Table II: χ from {what}, median [range] over {seeds_text(options)}",
        ["row", "χ", "measured here", "setting", "paper", *METHODS],
    )
    names = list(ROW_SETTINGS)[:1] if options.quick else options.settings or tuple(ROW_SETTINGS)
    measured: Measured = {name: [] for name in names}
    for row in rows:
        if row.make is None:
            told = ", ".join(_printed(row.name, name) for name in SETTINGS)
            nothing = ["–"] * len(METHODS)
            table.add(row.name, TABLE_2[row.name][0], f"D: {shapes.CLASSES['D']}", "all", told, *nothing)
            continue
        mesh = row.make()
        euler = tk.from_mesh(mesh).report().euler  # counted: a network's level set need not be its model's
        assert euler is not None
        told = f"{row.kind}: {row.text or shapes.CLASSES[row.kind]}"
        for name in names:
            has_report = name == REPORTED and not options.quick and not with_vertices
            found = answers(mesh, ROW_SETTINGS[name], options.seeds, has_report, with_vertices)
            measured[name].append((row.name, euler, found))
            cells = [_range(found.values[method]) for method in ESTIMATES]
            table.add(row.name, euler, told, name, _printed(row.name, name), *cells, _integers(found))
    return table, measured


def _printed(row: str, setting: str) -> str:
    value = ours(row, setting)
    return "–" if value is None else f"{value:.2f}"


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


def score_table(measured: Measured) -> Table:
    """Shares of draws that are right, and the paper's printed values of the same rows, which are one draw each."""
    names = list(dict.fromkeys(name for found in measured.values() for name, _, _ in found))
    table = Table(
        f"The measured rows scored, all draws: {', '.join(names)}",
        ["setting", "method", "right by 2·round(χ/2)", "within ½", "mean error", "median error"],
    )
    for setting, found in measured.items():
        same = {name: euler for name, euler, _ in found if TABLE_2[name][0] == euler}
        pairs: list[tuple[Value, int]] = [(ours(name, setting), euler) for name, euler in same.items()]
        if same and setting in SETTINGS:
            table.add(setting, "the paper's numbers, rows of the same χ", *_share(pairs))
        for method in METHODS:
            pairs = [(value, euler) for _, euler, one in found for value in one.values[method]]
            if pairs:
                table.add(setting, method, *_share(pairs))
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


def tables_of_rows(options: Options, wanted: Sequence[str]) -> list[Table]:
    """Table II, from samples alone and with all vertices of the paper's own files; both and the paper's scored."""
    rows = list(shapes.rows(options.data, options.thingi10k))
    if options.rows:
        rows = sorted((row for row in rows if row.name in options.rows), key=lambda row: options.rows.index(row.name))
    if options.quick:  # meshes of networks take half a minute each
        rows = [row for row in rows if row.kind != "B" and row.name != "Bunny"]
    found = []
    if "rows" in wanted:
        table, measured = row_table(options, rows)
        found += [table, score_table(measured), paper_score()]
    if "vertices" in wanted:
        own = [row for row in rows if row.kind in ("A", "A′", "T")]
        table, measured = row_table(options, own, with_vertices=True)
        found += [table, score_table(measured)]
    return found


def tables_of_clean_meshes(options: Options, wanted: Sequence[str]) -> list[Table]:
    """All methods on the clean meshes of the data, without and with noise; on shapes made here if there is no data."""
    if options.data is None:
        rows = [row for row in shapes.rows(None, None) if row.make is not None]
        known = [(row.name, row.euler, row.make()) for row in rows if row.make is not None]
        table = clean_table("Shapes made by topokit.testing", known, ROW_SETTINGS["5 k"], options)
        table.notes.append("Without --data the rows that need its files, and the table of clean meshes, are left out.")
        return [table]
    clean = shapes.clean_meshes(options.data)[:: 8 if options.quick else options.every]
    meshes = [(name, euler, shapes.read(path)) for name, euler, path in clean]
    settings = {"clean": ROW_SETTINGS[REPORTED], "noisy": ROW_SETTINGS[NOISY]}
    title = f"{len(meshes)} clean meshes"
    names = [name for name in settings if name in wanted and not (name == "noisy" and options.quick)]
    return [clean_table(title, meshes, settings[name], options) for name in names]


PARTS = ("rows", "vertices", "clean", "noisy")


def tables(options: Options) -> list[Table]:
    """Table II, the paper's numbers scored again, and all clean meshes of the data."""
    torch.manual_seed(0)  # nothing here draws from it, but MeshLab's and Open3D's bindings may
    wanted = PARTS if options.part == "all" else (options.part,)
    found = tables_of_rows(options, wanted)
    if {"clean", "noisy"} & set(wanted):
        found += tables_of_clean_meshes(options, wanted)
    for package in ("pymeshlab", "open3d", "gudhi"):
        if not installed(package):
            found[-1].notes.append(missing(package, "its methods"))
    return found
