"""The paper's estimate of curvature and χ, with normals that are given or estimated in one of two ways."""

from __future__ import annotations

from dataclasses import replace

from torch import Tensor

from topokit.core.local.curvature import Curvature, CurvatureSettings, surface_curvature
from topokit.core.local.gauss_bonnet import euler_characteristic
from topokit.core.samples import SurfaceSamples

NORMALS = ("given", "pca", "quadric")


def curvature_with(
    kind: str,
    points: Tensor,
    known_normals: Tensor,
    settings: CurvatureSettings,
    neighbors: Tensor | None = None,
) -> Curvature:
    """Curvature with one of the kinds `NORMALS`; the known normals count where they are "given".

    Args:
        kind: one of `NORMALS`.
        points: (N, 3).
        known_normals: (N, 3), unit.
        settings: all but the way to normals.
        neighbors: (N, at least k) indices, nearest first, of which the first k are taken; searched otherwise.
    """
    nearest = None if neighbors is None else neighbors[:, : settings.n_neighbors].contiguous()
    settings = replace(settings, normal_method="quadric" if kind == "quadric" else "pca")
    return surface_curvature(
        SurfaceSamples(points, known_normals if kind == "given" else None), settings, neighbors=nearest
    )


def euler_of(local: Curvature) -> float:
    """χ⁽⁰⁾ without the term of a boundary: all shapes here are closed."""
    return float(euler_characteristic(local.gaussian, local.area))


def estimate(kind: str, points: Tensor, known_normals: Tensor, k: int, neighbors: Tensor | None = None) -> float:
    """χ⁽⁰⁾ with k neighbors; arguments as of `curvature_with`."""
    return euler_of(curvature_with(kind, points, known_normals, CurvatureSettings(k), neighbors))
