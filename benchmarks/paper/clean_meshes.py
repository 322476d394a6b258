"""The same question for many meshes: how often each method finds χ of a cloud, and for how many processor seconds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from statistics import median

from torch import Tensor

import topokit as tk
from benchmarks.paper import baselines, shapes
from benchmarks.paper.estimates import estimate
from benchmarks.paper.scores import Setting, Value, errors, is_right, near
from benchmarks.paper.tables import Options, Table, installed, timed

K_VALUES = (16, 20, 30)
MESHLAB_FILTERS = baselines.MESHLAB[1:]  # the three that the paper's Table II has
HEADER = ["right by 2·round(χ/2)", "within ½", "median error", "median CPU s"]
REPORT = "`report()`, no normals"
Answer = tuple[str, Value, float]


@dataclass(frozen=True)
class Cloud:
    """Points (N, 3), the normals of the faces that they were drawn from, and χ of the surface."""

    points: Tensor
    normals: Tensor
    euler: int


@dataclass
class Score:
    """Values of one method beside the truth, and the processor seconds of each."""

    values: list[tuple[Value, int]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def cells(self) -> list[str]:
        found = errors(self.values)
        silent = sum(value is None for value, _ in self.values)
        return [
            f"{sum(is_right(*pair) for pair in self.values)} / {len(self.values)}"
            + (f", {silent} without an answer" if silent else ""),
            f"{near(self.values)} / {len(self.values)}",
            f"{median(found):.2f}" if found else "–",
            f"{median(self.seconds):.2f}" if self.seconds else "–",
        ]


def by_curvature(cloud: Cloud) -> Iterator[Answer]:
    """The paper's estimate with the faces' normals, PCA normals and quadric normals."""
    named = {
        **{f"χ⁽⁰⁾, true normals, k = {k}": ("given", k) for k in K_VALUES},
        **{f"χ⁽⁰⁾, PCA normals, k = {k} (the paper)": ("pca", k) for k in K_VALUES},
        "χ⁽⁰⁾, quadric normals, k = 20 (`gauss_bonnet(20)`)": ("quadric", 20),
    }
    for name, (kind, k) in named.items():
        yield (name, *timed(lambda kind=kind, k=k: estimate(kind, cloud.points, cloud.normals, k)))


def by_report(cloud: Cloud) -> Iterator[Answer]:
    """The report, and the same where it says "likely"."""
    report, seconds = timed(lambda: tk.from_points(cloud.points).report())
    yield REPORT, report.euler, seconds
    if report.verdict == "likely":
        yield f"{REPORT}, where it says “likely”", report.euler, seconds


def by_poisson(cloud: Cloud) -> Iterator[Answer]:
    """χ of screened Poisson meshes, and MeshLab's filters on that with true normals, with the mesh's seconds."""
    mesh, seconds = timed(lambda: baselines.poisson_mesh(cloud.points, None))
    yield "Poisson mesh, no normals: V − E + F", baselines.euler_of_mesh(mesh), seconds
    mesh, seconds = timed(lambda: baselines.poisson_mesh(cloud.points, cloud.normals))
    yield "Poisson mesh, true normals: V − E + F", baselines.euler_of_mesh(mesh), seconds
    if installed("pymeshlab"):
        for name in MESHLAB_FILTERS:
            value, own = timed(lambda name=name: meshlab_euler(mesh, name))
            yield f"MeshLab {name} on that mesh", value, seconds + own


def meshlab_euler(mesh: baselines.Triangles, name: str) -> Value:
    """Σ K A/2π by one of MeshLab's filters; None for meshes that it refuses."""
    curvature = baselines.meshlab_curvature(mesh, name)
    if curvature is None:
        return None
    return float((curvature[0] * baselines.vertex_areas(mesh)).nansum()) / (2 * math.pi)


def by_persistence(cloud: Cloud) -> Iterator[Answer]:
    """χ read off the bars of the alpha complex."""
    (_, bars), seconds = timed(lambda: baselines.alpha_bars(cloud.points))
    plateaus = baselines.plateaus(cloud.points, bars)
    yield "alpha complex, longest plateau of an even χ", baselines.longest_plateau(plateaus), seconds
    yield "alpha complex, best α in hindsight", baselines.nearest_plateau(plateaus, cloud.euler), seconds


WAYS: dict[str, Callable[[Cloud], Iterator[Answer]]] = {
    "curvature": by_curvature,
    "report": by_report,
    "poisson": by_poisson,
    "persistence": by_persistence,
}
"""Groups of methods by name."""
NEEDED = {"poisson": "open3d", "persistence": "gudhi"}


def clean_table(title: str, meshes: list[tuple[str, int, shapes.Mesh]], setting: Setting, options: Options) -> Table:
    """Every method, or those that were asked for, on every mesh, one draw each."""
    wanted = ("curvature",) if options.quick else options.methods or tuple(WAYS)
    ways = [WAYS[name] for name in wanted if name not in NEEDED or installed(NEEDED[name])]
    scores: dict[str, Score] = {}
    for name, euler, mesh in meshes:
        progress = Table(name, [])  # so that a long run tells where it is
        cloud = Cloud(*shapes.samples(mesh, setting.n_points, 0, setting.noise), euler)
        for way in ways:
            for method, value, seconds in way(cloud):
                score = scores.setdefault(method, Score())
                score.values.append((value, euler))
                score.seconds.append(seconds)
                progress.add(euler, setting.text, method, value, f"{seconds:.2f}")
    table = Table(f"{title}: {setting.text} points, one draw each", ["method", *HEADER])
    for method, score in scores.items():
        table.add(method, *score.cells())
    return table
