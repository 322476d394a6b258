"""The error of curvature against noise, density, number of neighbors and kind of normals; and against its peers."""

from __future__ import annotations

from collections.abc import Callable
from statistics import mean

import torch
from torch import Tensor

import topokit as tk
from benchmarks.paper.baselines import corrected_curvature, jet_curvature
from benchmarks.paper.surfaces import STUDY, noisy
from benchmarks.paper.tables import Options, Table, seeds_text, spread, timed
from topokit.core.local.curvature import CurvatureSettings, surface_curvature
from topokit.core.neighbors import nearest_neighbors
from topokit.core.samples import SurfaceSamples
from topokit.testing import AnalyticSamples

NOISE = (0.0, 0.0025, 0.005, 0.01)
K_VALUES = (20, 40, 80, 160)
PEER_K = (20, 28, 40, 57, 80, 113, 160, 226, 320)  # √2 apart
SIZES = (1_000, 3_000, 10_000, 30_000)
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


def shapes_with(known: AnalyticSamples, points: Tensor) -> dict[str, tk.Shape]:
    """The cloud with each kind of normals; those of "PCA" and "quadric" are estimated later."""
    plain = tk.from_points(points)
    oriented = plain.oriented()
    given = tk.from_points(points, known.normals)
    kinds = {"PCA": plain, "quadric": plain, "given": given, "witness": oriented}
    return kinds | {"regularized": oriented.regularized()}


def measured(known: AnalyticSamples, shape: tk.Shape, kind: str, k: int | None) -> Errors:
    """Errors of a shape with k neighbors; None is the automatic choice."""
    local = shape.curvature(k, normal_method="pca" if kind == "PCA" else "quadric")
    return errors(known, local.gaussian, local.mean, local.normals)


def normals_table(options: Options) -> Table:
    """Errors of K and H for kinds of normals, noise and k."""
    n = 2_000 if options.quick else 10_000
    table = Table(
        f"Median error of K / H in %, by kind of normals: {n} points, {seeds_text(options)}",
        ["surface", "noise", "normals", *(f"k = {k}" for k in K_VALUES), "automatic"],
    )
    for surface in reversed(STUDY):
        for share in NOISE:
            found = draws(surface, n, share, options.seeds)
            shapes = [(known, shapes_with(known, points)) for known, points in found]
            for kind in shapes[0][1]:
                pairs = [(known, one[kind]) for known, one in shapes]
                cells = [percent([measured(*pair, kind, k) for pair in pairs]) for k in (*K_VALUES, None)]
                table.add(surface, f"{100 * share:g} %", kind, *cells)
    return table


def density_table(options: Options) -> Table:
    """Errors of the automatic choice against those of PCA normals with k = 20, by density."""
    table = Table(
        f"Median error of K / H in % by density, no normals, {seeds_text(options)}",
        ["surface", "noise", "points", "automatic k", "automatic", "worst draw", "PCA, k = 20"],
    )
    for shape in STUDY:
        for share in NOISE:
            for n in SIZES[:2] if options.quick else SIZES:
                found = draws(shape, n, share, options.seeds)
                locals_ = [tk.from_points(points).curvature() for _, points in found]
                known = [one for one, _ in found]
                pairs = zip(known, locals_, strict=True)
                default = [errors(one, local.gaussian, local.mean, local.normals) for one, local in pairs]
                sizes = sorted({local.neighbors.shape[-1] for local in locals_})
                plain = [measured(one, tk.from_points(points), "PCA", 20) for one, points in found]
                worst = " / ".join(f"{100 * max(column):.1f}" for column in zip(*default, strict=True))
                k = " to ".join(str(size) for size in dict.fromkeys((sizes[0], sizes[-1])))
                table.add(shape, f"{100 * share:g} %", n, k, percent(default), worst, percent(plain))
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
    paper = CurvatureSettings(normal_method="pca")
    normals = surface_curvature(SurfaceSamples(points), paper, neighbors=neighbors).normals
    normals = normals * torch.where((normals * known.normals).sum(-1, keepdim=True) < 0, -1.0, 1.0)
    return errors(known, *corrected_curvature(points, normals, neighbors), normals)


PEERS: dict[str, Peer] = {
    "paper: PCA normals": _plain,
    "jet fit": _jets,
    "corrected measures": _corrected,
}


def peers_table(options: Options) -> Table:
    """The default against its peers, each with the k that is best for it on the first draw of that very cloud."""
    n = 2_000 if options.quick else 10_000
    table = Table(
        f"Median error of K in %: {n} points without normals, {seeds_text(options)}",
        ["surface", "noise", "topokit, automatic k", *(f"{name}, best k" for name in PEERS)],
    )
    for shape in STUDY:
        for share in NOISE:
            found = draws(shape, n, share, options.seeds)
            default, seconds = timed(lambda found=found: [_default(*one) for one in found])
            k = sorted(size for _, size in default)[len(default) // 2]
            cells = [_cell([error for error, _ in default], k, seconds)]
            cells += [_best(peer, found) for peer in PEERS.values()]
            table.add(shape, f"{100 * share:g} %", *cells)
    return table


def _default(known: AnalyticSamples, points: Tensor) -> tuple[float, int]:
    """The error of K with defaults, and the number of neighbors that was chosen."""
    local = tk.from_points(points).curvature()
    return errors(known, local.gaussian, local.mean, local.normals)[0], local.neighbors.shape[-1]


def _best(peer: Peer, found: list[tuple[AnalyticSamples, Tensor]]) -> str:
    """Errors of K on all draws with the k that has the least error on the first."""
    known, points = found[0]
    neighbors = nearest_neighbors(points, max(PEER_K))
    tried = [(peer(known, points, neighbors[:, :k].contiguous())[0], k) for k in PEER_K]
    best = min(tried)[1]
    run = lambda: [peer(*one, nearest_neighbors(one[1], best))[0] for one in found]  # noqa: E731
    own, seconds = timed(run)
    return _cell(own, best, seconds)


def _cell(found: list[float], k: int, seconds: float) -> str:
    return f"{spread([100 * one for one in found], 1)} (k = {k}, {seconds / len(found):.1f} s)"


PARTS = {"peers": peers_table, "normals": normals_table, "density": density_table}


def tables(options: Options) -> list[Table]:
    """Against peers, by kind of normals, and by density."""
    return [make(options) for name, make in PARTS.items() if options.part in ("all", name)]
