"""MeshLab's filters on meshes that are reconstructed from the points of Table I, as in the authors' notebook."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import KDTree
from torch import Tensor

from benchmarks.paper.baselines import MESHLAB, Triangles, meshlab_curvature, poisson_mesh
from benchmarks.paper.curvature_errors import HEADER, Found, cells, integral, outward
from benchmarks.paper.printed import PAPER_NAMES
from benchmarks.paper.surfaces import COLUMNS, FEW
from benchmarks.paper.tables import Options, Table, installed, missing, timed
from topokit.testing import AnalyticSamples

FILTERS = MESHLAB[1:]  # the time of "PCA" grows with the square of the number of vertices, of which there are 150 000


def without_doubles(mesh: Triangles) -> Triangles:
    """A mesh with one vertex where several coincide: MeshLab's filters end the process at triangles between them."""
    vertices, index = np.unique(mesh[0], axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh[1]]
    is_triangle = (faces != np.roll(faces, 1, axis=1)).all(1)
    return vertices, faces[is_triangle]


def at_points(known: AnalyticSamples, points: Tensor, mesh: Triangles, filter_name: str) -> Found | None:
    """Curvature at each point: that at the nearest vertex of the mesh; None for meshes that MeshLab refuses."""
    curvature, seconds = timed(lambda: meshlab_curvature(mesh, filter_name))
    if curvature is None:
        return None
    gaussian, mean = curvature
    nearest = torch.from_numpy(KDTree(mesh[0]).query(points.numpy())[1])
    return Found(gaussian[nearest], outward(mean[nearest], known), integral(gaussian, mesh), seconds)


def reconstructed_table(options: Options) -> Table:
    """MeshLab's filters on screened Poisson meshes of all columns, with the *true* normals given."""
    table = Table("MeshLab's filters on screened Poisson meshes, true normals", ["column", "draws", "filter", *HEADER])
    for package in ("pymeshlab", "open3d"):
        if not installed(package):
            table.notes.append(missing(package, "MeshLab on reconstructed meshes"))
            return table
    for name, column in COLUMNS.items():
        share, seeds = 0.05 if options.quick else 1.0, 1 if column.n_points > FEW else options.seeds
        draws = [column.samples(seed, share=share) for seed in range(seeds)]
        meshes = [without_doubles(poisson_mesh(points, known.normals)) for known, points in draws]
        for one in FILTERS:
            pairs = zip(draws, meshes, strict=True)
            found = [(known, at_points(known, points, mesh, one)) for (known, points), mesh in pairs]
            answered = [(known, result) for known, result in found if result is not None]
            printed = (PAPER_NAMES[one], name)
            shown = cells(answered, printed) if answered else ["refused"] + ["–"] * (len(HEADER) - 1)
            table.add(name, f"{len(answered)} of {seeds}", one, *shown)
    table.notes.append(
        "Open3D's screened Poisson of depth 8. A point has the curvature of the nearest vertex. Meshes that are not "
        "2-manifolds are refused by MeshLab and have no answer. Seconds are those of the filter, without the mesh."
    )
    return table
