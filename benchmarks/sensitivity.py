"""How much each setting of point clouds matters: every number halved and doubled, one at a time.

    python benchmarks/sensitivity.py DATA --out sensitivity.jsonl [--clouds 12] [--group orientation]
    python benchmarks/sensitivity.py --table sensitivity.jsonl > docs/sensitivity.csv

DATA holds index.json and the closed meshes that it names. The clouds of most settings are 10 000 random points of these
meshes without normals, clean and with 0.5 % noise, of every second mesh: of those with the right integer at the usual
settings the ones on which the votes agree least, so those that a change can tip. Other settings are tried on what they
are for: given normals, large clouds, wires, open surfaces, stray points, filled space, double sheets, cut walls.
Numbers near one, or that would become one, are moved to and from one: 0.996 becomes 0.998 and 0.992. Whole numbers stay
whole. `--out` is continued if it exists.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from confidence import clean_meshes, read_rows
from scale_truth import mesh_of
from tried_clouds import Cloud, clumps, cut_walls, filled, nested, sheets, shells, wires

from topokit.core.cloud.guards import far_points
from topokit.core.cloud.outliers import outliers
from topokit.core.cloud.settings import CloudSettings, OutlierSettings
from topokit.core.cloud.sheets import read_sheet
from topokit.core.cloud.witness import Witness, global_witness
from topokit.core.neighbors import nearest_neighbors
from topokit.errors import InputError
from topokit.report.verdict import THRESHOLDS

KINDS = {  # of clouds on which the settings of a group, or one setting, are tried; "hard" if not named
    "given": "given",
    "given.largest_residual": "nested",
    "sampling": "large",
    "noise": "large",
    "fields.most_points": "huge",
    "wires": "wires",
    "wires.open_radii": "sheets",
    "outliers": "strays",
    "guards": "filled",
    "guards.far": "clumps",
    "orientation.hidden": "filled",
    "doubles": "shells",
    "quality.facing": "cut walls",
    "quality.lid": "cut walls",
    "quality.uncovered": "cut walls",
}
MADE = {  # in tried_clouds.py
    "wires": wires,
    "sheets": sheets,
    "filled": filled,
    "clumps": clumps,
    "shells": shells,
    "nested": nested,
    "cut walls": cut_walls,
}
N_POINTS, MANY, HUGE = 10_000, 60_000, 250_000
NOISE, MUCH_NOISE = 0.005, 0.01  # standard deviations, in longest sides
MOVED = ("euler", "agreement", "lids", "resolution", "source", "wire")  # what a change may move
FLIPPED, STRAYS = (0.0, 0.03, 0.07, 0.2), 0.05  # shares of normals that are reversed, of points that are strays


@dataclass(frozen=True)
class Change:
    """One number of the settings, changed: "group.name", its index in a tuple or field in a record, the factor."""

    setting: str
    part: str
    factor: float

    @property
    def key(self) -> str:
        return f"{self.setting}{self.part} x {self.factor:g}"


class Clouds:
    """The clouds of each kind, made when they are asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.rows = folder, clean_meshes(folder)
        self.names = sorted(self.rows)

    def of(self, kind: str, count: int) -> dict[str, Callable[[], Cloud]]:
        """Functions that make the clouds of a kind, by name; of the hard ones those that are to be compared."""
        some = self.names[:: max(1, len(self.names) // count)][:count]
        if kind == "hard":
            noises = (0.0, NOISE)
            pairs = [(name, noise) for name in self.names[::2] for noise in noises]
            return {f"{name} {noise:g}": self._maker(name, N_POINTS, noise) for name, noise in pairs}
        if kind == "given":
            return {name: self._maker(name, N_POINTS, 0.0, flipped=FLIPPED[k % 4]) for k, name in enumerate(some)}
        if kind == "large":
            return {name: self._maker(name, MANY, MUCH_NOISE * (k % 2)) for k, name in enumerate(some)}
        if kind == "huge":
            return {name: self._maker(name, HUGE, NOISE) for name in some[:1]}
        if kind == "strays":
            return {name: self._maker(name, N_POINTS, 0.0, strays=STRAYS) for name in some}
        return dict(MADE[kind]())

    def _maker(self, name: str, count: int, noise: float, **options: float) -> Callable[[], Cloud]:
        return lambda: self._cloud(name, count, noise, **options)

    def _cloud(self, name: str, count: int, noise: float, flipped: float | None = None, strays: float = 0.0) -> Cloud:
        mesh = mesh_of(self.folder / self.rows[name]["path"])
        points, face = trimesh.sample.sample_surface(mesh, count, seed=0)
        rng = np.random.default_rng(0)
        points = np.asarray(points) + rng.normal(size=points.shape) * noise * np.ptp(points, axis=0).max()
        low, size = points.min(0), np.ptp(points, axis=0)
        stray = low + size * rng.uniform(-0.5, 1.5, (int(strays * count), 3))
        normals = None
        if flipped is not None:
            normals = mesh.face_normals[face] * np.where(rng.random(count) < flipped, -1.0, 1.0)[:, None]
        found = None if normals is None else torch.from_numpy(normals)
        return Cloud(torch.from_numpy(np.concatenate((points, stray))), found, int(self.rows[name]["chi"]))


def changes() -> Iterator[Change]:
    """Every number of the settings, halved and doubled."""
    usual = CloudSettings()
    groups = {"outliers": OutlierSettings(), **{one.name: getattr(usual, one.name) for one in fields(usual)}}
    for group, settings in groups.items():
        for one in fields(settings):
            for part in parts_of(getattr(settings, one.name)):
                for factor in (0.5, 2.0):
                    yield Change(f"{group}.{one.name}", part, factor)


def parts_of(value: Any) -> Sequence[str]:
    """The numbers that are changed together: the same term of all records, the same place of all rows, or all."""
    if isinstance(value, tuple) and is_dataclass(value[0]):
        return [f"[{one.name}]" for one in fields(value[0])]
    if isinstance(value, tuple) and isinstance(value[0], tuple):
        return [f"[{place}]" for place in range(len(value[0]))]
    return ("",)


def changed(value: Any, part: str, factor: float) -> Any:
    """A setting's value with the numbers of a part multiplied."""
    if isinstance(value, tuple):
        if part and is_dataclass(value[0]):
            return tuple(replace(one, **{part[1:-1]: factor * getattr(one, part[1:-1])}) for one in value)
        if part:
            place = int(part[1:-1])
            return tuple((*row[:place], scaled(row[place], factor), *row[place + 1 :]) for row in value)
        return tuple(scaled(one, factor) for one in value)
    return scaled(value, factor)


def scaled(value: float, factor: float) -> float:
    """A number multiplied; one from 0.9 to 1, or that would become one, moved to or from one."""
    if isinstance(value, int):
        return max(1, round(value * factor))
    return 1 - (1 - value) / factor if 0.9 <= value < 1 or value * factor == 1 else value * factor


def with_change(change: Change | None) -> tuple[CloudSettings, OutlierSettings]:
    """The settings with one change."""
    cloud, stray = CloudSettings(), OutlierSettings()
    if change is None:
        return cloud, stray
    group, name = change.setting.split(".")
    own = stray if group == "outliers" else getattr(cloud, group)
    own = replace(own, **{name: changed(getattr(own, name), change.part, change.factor)})
    return (cloud, own) if group == "outliers" else (replace(cloud, **{group: own}), stray)


def answer(kind: str, cloud: Cloud, change: Change | None) -> dict[str, Any]:
    """What the settings make of a cloud: the integer, whether all votes agree, and CPU seconds."""
    settings, stray = with_change(change)
    started = time.process_time()
    found: dict[str, Any]
    try:
        if kind == "sheets":
            reading = read_sheet(cloud.points, nearest_neighbors(cloud.points, 24), settings.wires)
            euler, share = next(iter(reading.shares.items())) if reading else (None, 0.0)
            found = {"euler": euler, "agreement": share}
        else:
            points = cloud.points
            if kind == "strays":
                points = points[~outliers(points, stray)]
            if kind == "clumps":
                points = points[~far_points(points, settings.guards)]
            found = described(global_witness(points, cloud.normals, settings=settings))
    except InputError as error:
        found = {"euler": None, "agreement": 0.0, "error": str(error)}
    return {**found, "right": found["euler"] == cloud.truth, "seconds": round(time.process_time() - started, 2)}


def described(witness: Witness) -> dict[str, Any]:
    """The numbers of a witness that a change may move."""
    wire, signs, is_double = witness.wire, witness.signs, not THRESHOLDS["double"].allows(witness.quality.double)
    return {
        "euler": witness.euler,
        "agreement": witness.agreement,
        "lids": len(witness.lids),
        "resolution": witness.resolution / witness.spacing,
        "source": f"{witness.preparation}, {signs.source} {signs.confirmed}{', double' * is_double}",
        "wire": None if wire is None else [wire.contrast, wire.smallest, wire.largest, wire.narrowness, wire.n_stray],
    }


def kind_of(setting: str) -> str:
    """The clouds on which a setting is tried."""
    return KINDS.get(setting, KINDS.get(setting.split(".")[0], "hard"))


def collect(options: argparse.Namespace) -> None:
    """Add the answers that the file lacks: the usual settings first, then every change."""
    clouds, rows = Clouds(options.data), read_rows(options.out) if options.out.exists() else []
    known = {(row["change"], row["kind"], row["cloud"]) for row in rows}
    with options.out.open("a") as file:

        def note(kind: str, name: str, make: Callable[[], Cloud], change: Change | None) -> None:
            key = "usual" if change is None else change.key
            if (key, kind, name) in known:
                return
            row = {"change": key, "kind": kind, "cloud": name, **answer(kind, make(), change)}
            rows.append(row)
            file.write(json.dumps(row) + "\n")
            file.flush()

        wanted = [one for one in changes() if one.setting.startswith(options.group)]
        for kind in dict.fromkeys(kind_of(one.setting) for one in wanted):
            made = clouds.of(kind, options.clouds)
            for name, make in made.items():
                note(kind, name, make, None)
            usual = [row for row in rows if row["change"] == "usual" and row["kind"] == kind and row["cloud"] in made]
            hardest = sorted(usual, key=lambda row: (not row["right"], row["agreement"], row["cloud"]))[
                : options.clouds
            ]
            for change in wanted:
                if kind_of(change.setting) == kind:
                    for row in hardest:
                        note(kind, row["cloud"], made[row["cloud"]], change)


def table(path: Path) -> Iterator[tuple[str, ...]]:
    """A row for every number: what halving and doubling it do to the clouds on which it was tried."""
    rows = read_rows(path)
    usual = {(row["kind"], row["cloud"]): row for row in rows if row["change"] == "usual"}
    yield ("setting", "clouds", "right", "half", "double", "half: moved", "double: moved", "half: CPU", "double: CPU")
    for change in changes():
        if change.factor > 1:
            continue
        both = [summed(rows, usual, replace(change, factor=factor)) for factor in (0.5, 2.0)]
        if all(both):
            (n, right, *half), (_, _, *double) = both
            columns = [text for pair in zip(half, double, strict=True) for text in pair]
            yield (change.setting + change.part, n, right, *columns)


def summed(rows: list[dict[str, Any]], usual: dict[tuple[str, str], dict[str, Any]], change: Change) -> tuple[str, ...]:
    """Clouds, right ones at the usual settings, the change of that, answers that moved, ratio of CPU seconds."""
    mine = [row for row in rows if row["change"] == change.key]
    if not mine:
        return ()
    before = [usual[row["kind"], row["cloud"]] for row in mine]
    right, now = (sum(row["right"] for row in one) for one in (before, mine))
    moved = sum(
        any(row.get(name) != other.get(name) for name in MOVED) for row, other in zip(mine, before, strict=True)
    )
    seconds = [sum(row["seconds"] for row in one) for one in (before, mine)]
    return str(len(mine)), str(right), f"{now - right:+d}", str(moved), f"{seconds[1] / max(seconds[0], 0.01):.2f}"


def main() -> None:
    """Collect answers, or print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="?", help="folder with index.json")
    parser.add_argument("--out", type=Path, help="JSON lines; continued if it exists")
    parser.add_argument("--clouds", type=int, default=12, help="that each number is tried on")
    parser.add_argument("--group", default="", help="only settings whose name starts so")
    parser.add_argument("--table", type=Path, help="print the table of this file")
    options = parser.parse_args()
    if options.table:
        csv.writer(sys.stdout, lineterminator="\n").writerows(table(options.table))
    elif options.data and options.out:
        collect(options)
    else:
        parser.error("give DATA and --out, or --table")


if __name__ == "__main__":
    main()
