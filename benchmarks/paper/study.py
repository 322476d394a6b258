"""The error of curvature against noise, density, number of neighbors and kind of normals; and against its peers."""

from __future__ import annotations

from collections.abc import Callable
from statistics import mean

import torch
from torch import Tensor

import topokit as tk
from benchmarks.paper.baselines import corrected_curvature, jet_curvature
from benchmarks.paper.surfaces import STUDY, noisy
from benchmarks.paper.tables import Options, Table, timed
from topokit.core.local.curvature import CurvatureSettings, surface_curvature
from topokit.core.neighbors import nearest_neighbors
from topokit.core.samples import SurfaceSamples
from topokit.testing import AnalyticSamples

NOISE = (0.0, 0.0025, 0.005, 0.01)
K_VALUES = (20, 40, 80, 160, 320)
Errors = tuple[float, float]


def errors(known: AnalyticSamples, gaussian: Tensor, mean_curvature: Tensor, normals: Tensor) -> Errors:
    """Median errors of K and H as shares of the median |K| and |H|; H with the sign of the outward normal."""
    sign = torch.where((normals * known.normals).sum(-1) < 0, -1.0, 1.0)
    pairs = ((gaussian, known.gaussian), (sign * mean_curvature, known.mean))
    return tuple(float((a - b).abs().median() / b.abs().median()) for a, b in pairs)  # type: ignore[return-value]


def percent(values: list[Errors]) -> str:
    """Means over the seeds, of K and of H."""
    return " / ".join(f"{100 * mean(column):.1f}" for column in zip(*values, strict=True))


def draws(shape: str, n: int, share: float, seeds: int) -> list[tuple[AnalyticSamples, Tensor]]:
    """The surface and its noisy points for each seed."""
    known = [STUDY[shape](n, torch.Generator().manual_seed(seed)) for seed in range(seeds)]
    return [(one, noisy(one, share, seed)) for seed, one in enumerate(known)]


def shape_with(known: AnalyticSamples, points: Tensor, kind: str) -> tk.Shape:
    """The cloud with one kind of normals: given, of the witness, regularized, or none ("PCA" and "quadric")."""
    if kind in ("witness", "regularized"):
        oriented = tk.from_points(points).oriented()
        return oriented.regularized() if kind == "regularized" else oriented
    return tk.from_points(points, known.normals if kind == "given" else None)


def measured(known: AnalyticSamples, shape: tk.Shape, kind: str, k: int | None) -> Errors:
    """Errors of a shape with k neighbors; None is the automatic choice."""
    local = shape.curvature(k, normal_method="pca" if kind == "PCA" else "quadric")
    return errors(known, local.gaussian, local.mean, local.normals)


def normals_table(options: Options, surfaces: tuple[str, ...], kinds: tuple[str, ...], seeds: int) -> Table:
    """Errors of K and H for kinds of normals, noise and k."""
    n = 2_000 if options.quick else 10_000
    table = Table(
        f"Median error of K / H in %, by kind of normals: {n} points, seeds: {seeds}",
        ["surface", "noise", "normals", *(f"k = {k}" for k in K_VALUES), "automatic"],
    )
    for surface in surfaces:
        for share in NOISE:
            found = draws(surface, n, share, seeds)
            for kind in kinds:
                shapes = [(known, shape_with(known, points, kind)) for known, points in found]
                sizes = (*K_VALUES, None)
                cells = [percent([measured(*one, kind, k) for one in shapes]) for k in sizes]
                table.add(surface, f"{100 * share:g} %", kind, *cells)
    return table


def density_table(options: Options) -> Table:
    """Errors of the automatic choice against those of k = 20, by density."""
    sizes = (1_000, 3_000) if options.quick else (1_000, 3_000, 10_000, 30_000)
    seeds = 1 if options.quick else min(options.seeds, 2)
    table = Table(
        f"Median error of K / H in % by density, automatic against PCA with k = 20, seeds: {seeds}",
        ["surface", "noise", "points", "automatic k", "automatic", "PCA, k = 20"],
    )
    for shape in STUDY:
        for share in NOISE:
            for n in sizes:
                found = draws(shape, n, share, seeds)
                k = tk.from_points(found[0][1]).curvature().neighbors.shape[-1]
                shapes = [(known, tk.from_points(points)) for known, points in found]
                default = percent([measured(*one, "quadric", None) for one in shapes])
                plain = percent([measured(*one, "PCA", 20) for one in shapes])
                table.add(shape, f"{100 * share:g} %", n, k, default, plain)
    return table


Peer = Callable[[AnalyticSamples, Tensor, Tensor], Errors]


def _plain(known: AnalyticSamples, points: Tensor, neighbors: Tensor, method: str = "pca") -> Errors:
    settings = CurvatureSettings(normal_method=method)  # type: ignore[arg-type]
    local = surface_curvature(SurfaceSamples(points), settings, neighbors=neighbors)
    return errors(known, local.gaussian, local.mean, local.normals)


def _jets(known: AnalyticSamples, points: Tensor, neighbors: Tensor) -> Errors:
    return errors(known, *jet_curvature(points, neighbors))


def _corrected(known: AnalyticSamples, points: Tensor, neighbors: Tensor) -> Errors:
    """With PCA normals of the same neighbors, turned outward by the truth: the kindest way to have oriented points."""
    normals = surface_curvature(SurfaceSamples(points), neighbors=neighbors).normals
    normals = normals * torch.where((normals * known.normals).sum(-1, keepdim=True) < 0, -1.0, 1.0)
    return errors(known, *corrected_curvature(points, normals, neighbors), normals)


PEERS: dict[str, Peer] = {
    "paper: PCA normals": _plain,
    "jet fit": _jets,
    "corrected measures": _corrected,
}


def peers_table(options: Options) -> Table:
    """The default against its peers, each with the k that is best for it on that very cloud."""
    n = 2_000 if options.quick else 10_000
    seeds = 1 if options.quick else min(options.seeds, 2)
    table = Table(
        f"Median error of K in % and seconds: {n} points without normals, seeds: {seeds}",
        ["surface", "noise", "topokit, automatic k", *(f"{name}, best k" for name in PEERS)],
    )
    for shape in STUDY:
        for share in NOISE:
            found = draws(shape, n, share, seeds)
            shapes = [(known, tk.from_points(points)) for known, points in found]
            default, seconds = timed(lambda shapes=shapes: [measured(*one, "quadric", None) for one in shapes])
            k = tk.from_points(found[0][1]).curvature().neighbors.shape[-1]
            cells = [f"{100 * mean(e[0] for e in default):.1f} (k = {k}, {seconds / seeds:.1f} s)"]
            for peer in PEERS.values():
                cells.append(_best(peer, found))
            table.add(shape, f"{100 * share:g} %", *cells)
    return table


def _best(peer: Peer, found: list[tuple[AnalyticSamples, Tensor]]) -> str:
    """The least error of K over all k, that k, and the seconds it took."""
    tried = []
    neighbors = [nearest_neighbors(points, max(K_VALUES)) for _, points in found]
    for k in K_VALUES:
        runs = zip(found, neighbors, strict=True)
        own, seconds = timed(lambda runs=runs, k=k: [peer(*one, index[:, :k].contiguous()) for one, index in runs])
        tried.append((mean(e[0] for e in own), k, seconds / len(found)))
    error, k, seconds = min(tried)
    return f"{100 * error:.1f} (k = {k}, {seconds:.1f} s)"


def tables(options: Options) -> list[Table]:
    """By kind of normals, by density, and against peers."""
    seeds = min(options.seeds, 3)
    first = normals_table(options, tuple(STUDY), ("PCA", "quadric", "given"), seeds)
    second = normals_table(options, ("torus",), ("witness", "regularized"), 1)
    return [peers_table(options), first, second, density_table(options)]
