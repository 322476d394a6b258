"""Other ways to curvature and topology of points: jets, corrected curvature measures, MeshLab, Poisson, alpha complex.

Written from the formulas in the papers that are cited. Optional packages: `pymeshlab`, `open3d`, `gudhi`.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, Delaunay
from torch import Tensor

from benchmarks.paper.printed import PAPER_NAMES
from benchmarks.paper.surfaces import Column
from topokit.core.linalg import normalize
from topokit.core.local.quadric import fit_quadrics

Floats = NDArray[np.float64]
Triangles = tuple[Floats, NDArray[np.int64]]
MESHLAB = tuple(PAPER_NAMES)
"""MeshLab's filters."""

_PAIRS = 1 << 20  # neighbors held at once
_HELD = 1.02  # ratio of the ends of an interval of α long enough to be read
_CLOSEST = 1e-3  # cosine between the normals of a triangle and of its corners below which it is left out


def jet_curvature(points: Tensor, neighbors: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """K, H and normals by a quadric fit to each neighborhood (Cazals, Pouget 2005, order 2).

    Args:
        points: (N, 3).
        neighbors: (N, k) indices.

    Returns:
        (N,), (N,) and (N, 3). The sign of H belongs to that of the normal.
    """
    parts = []
    for rows in torch.arange(len(points)).split(max(1, _PAIRS // neighbors.shape[1] // 4)):
        fit = fit_quadrics(points[neighbors[rows]] - points[rows, None])
        radius = fit.radius[:, 0, 0]
        slope = fit.coefficients[:, 1:3]
        xx, xy, yy = (fit.coefficients[:, 3:] / radius[:, None]).unbind(1)
        x, y = slope.unbind(1)
        w = 1 + x * x + y * y
        gaussian = (xx * yy - xy * xy) / w.square()
        mean = -((1 + x * x) * yy - 2 * x * y * xy + (1 + y * y) * xx) / (2 * w**1.5)
        up = torch.nn.functional.pad(-slope, (0, 1), value=1.0)
        parts.append((gaussian, mean, normalize((up[:, None] @ fit.frames).squeeze(1))))
    gaussian, mean, normals = (torch.cat(column) for column in zip(*parts, strict=True))
    return gaussian, mean, normals


def corrected_curvature(
    points: Tensor, normals: Tensor, neighbors: Tensor, n_triangles: int = 64
) -> tuple[Tensor, Tensor]:
    """K and H by corrected curvature measures of random triangles among the neighbors.

    Args:
        points: (N, 3).
        normals: (N, 3), unit and oriented.
        neighbors: (N, k) indices.
        n_triangles: triangles per point.

    Reference:
        J.-O. Lachaud, D. Coeurjolly, C. Labart, P. Romon, B. Thibert, "Lightweight curvature estimation on point clouds
        with randomized corrected curvature measures", CGF 42(5), 2023, doi:10.1111/cgf.14910.
    """
    generator = torch.Generator().manual_seed(0)
    parts = []
    for rows in torch.arange(len(points)).split(max(1, _PAIRS // (3 * n_triangles) // 4)):
        index = neighbors[rows]
        size = (len(rows), 3 * n_triangles)  # a corner drawn twice makes a triangle without area, which is left out
        pick = torch.randint(index.shape[1], size, generator=generator)
        corners = index.gather(1, pick).reshape(len(rows), n_triangles, 3)
        parts.append(_measures(points[corners], normals[corners]))
    area, mean, gaussian = (torch.cat(column) for column in zip(*parts, strict=True))
    area = area.where(area > 0, torch.inf)
    return gaussian / area, mean / (2 * area)


def _measures(x: Tensor, u: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Area, mean and Gaussian measures μ₀, μ₁, μ₂ of interpolated normals, summed over triangles (m, T, 3, 3)."""
    cross = torch.linalg.cross
    middle = normalize(u.mean(2))
    face = cross(x[:, :, 1] - x[:, :, 0], x[:, :, 2] - x[:, :, 0])
    side = (middle * face).sum(-1)
    sign = torch.where(side < 0, -1.0, 1.0)
    middle = u.mean(2)
    edges = (
        cross(u[:, :, 2] - u[:, :, 1], x[:, :, 0])
        + cross(u[:, :, 0] - u[:, :, 2], x[:, :, 1])
        + cross(u[:, :, 1] - u[:, :, 0], x[:, :, 2])
    )
    volume = (u[:, :, 0] * cross(u[:, :, 1], u[:, :, 2])).sum(-1)
    measures = ((middle * face).sum(-1), (middle * edges).sum(-1), volume)
    is_good = side.abs() > _CLOSEST * face.norm(dim=-1)
    return tuple((sign * one / 2 * is_good).sum(1) for one in measures)  # type: ignore[return-value]


def parameter_mesh(column: Column, known: Tensor, points: Tensor) -> Triangles:
    """The Delaunay mesh of noise-free points over the surface's parameters, with its vertices at `points`."""
    parameters = column.parameters(known)
    if parameters.shape[1] == 3:  # an ellipsoid: its affine image is a sphere, whose Delaunay mesh is the convex hull
        hull = ConvexHull(parameters.numpy())
        faces = np.asarray(hull.simplices, dtype=np.int64)
        flip = (hull.equations[:, :3] * np.cross(*_edges(parameters.numpy(), faces))).sum(1) < 0
        faces[flip] = faces[flip, ::-1]
        return points.numpy(), faces
    n = len(parameters)
    shifts = [2 * math.pi * np.array((i, j)) for i in (0, -1, 1) for j in (0, -1, 1)]
    tiled = np.concatenate([parameters.numpy() + shift for shift in shifts])
    keep = np.flatnonzero((np.abs(tiled) < 1.3 * math.pi).all(1))
    triangles = keep[Delaunay(tiled[keep]).simplices]
    middle = tiled[triangles].mean(1)
    faces = triangles[((middle >= -math.pi) & (middle < math.pi)).all(1)] % n
    return points.numpy(), faces


def _edges(vertices: Floats, faces: NDArray[np.int64]) -> tuple[Floats, Floats]:
    corners = vertices[faces]
    return corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]


def meshlab_curvature(mesh: Triangles, filter_name: str) -> tuple[Tensor, Tensor] | None:
    """K and H at the vertices by one of MeshLab's filters; None for meshes that it refuses: not 2-manifolds."""
    import pymeshlab

    def values(kind: str) -> Tensor:
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(*mesh))
        meshes.compute_curvature_principal_directions_per_vertex(
            method=filter_name, curvcolormethod=f"{kind} Curvature", autoclean=False
        )
        return torch.from_numpy(meshes.current_mesh().vertex_scalar_array().copy())

    try:
        return values("Gaussian"), values("Mean")
    except pymeshlab.PyMeshLabException as error:
        if "manifold" not in str(error):
            raise
        return None


def poisson_mesh(points: Tensor, normals: Tensor | None) -> Triangles:
    """Open3D's screened Poisson mesh of points; without normals they are oriented by tangent planes first."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points.numpy()))
    if normals is None:
        cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(16))
        cloud.orient_normals_consistent_tangent_plane(16)
    else:
        cloud.normals = open3d.utility.Vector3dVector(normals.numpy())
    mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=8, n_threads=1)
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles, dtype=np.int64)


def euler_of_mesh(mesh: Triangles) -> int:
    """V − E + F of the vertices that faces use."""
    faces = mesh[1]
    edges = np.sort(np.concatenate((faces[:, :2], faces[:, 1:], faces[:, ::2])), axis=1)
    return len(np.unique(faces)) - len(np.unique(edges, axis=0)) + len(faces)


def vertex_areas(mesh: Triangles) -> Tensor:
    """A third of the area of the faces around each vertex."""
    vertices, faces = mesh
    area = np.linalg.norm(np.cross(*_edges(vertices, faces)), axis=1) / 6
    return torch.from_numpy(np.bincount(faces.ravel(), np.repeat(area, 3), len(vertices)))


def alpha_bars(points: Tensor) -> tuple[int, list[Floats]]:
    """Number of simplices of the alpha complex, and its bars (n, 2) of dimension 0, 1 and 2 in units of length."""
    import gudhi

    tree = gudhi.AlphaComplex(points=points.numpy()).create_simplex_tree()
    tree.compute_persistence(homology_coeff_field=2, persistence_dim_max=True)
    bars = [np.sqrt(np.maximum(tree.persistence_intervals_in_dimension(one), 0)) for one in range(3)]
    return tree.num_simplices(), bars


def spacing(points: Tensor) -> float:
    """The extent over √N."""
    return float((points.amax(0) - points.amin(0)).max()) / math.sqrt(len(points))


def plateaus(points: Tensor, bars: list[Floats]) -> list[tuple[int, float]]:
    """χ of the alpha complex and the length, in log α, of each interval on which it is constant.

    α goes from the spacing to a quarter of the extent. Balls of radius α around samples of a closed surface have its χ
    (that of the thickened surface) in between.
    """
    times = np.concatenate([one[:, end] for end in (0, 1) for one in bars])
    steps = np.concatenate([np.full(len(one), sign * (-1) ** d) for sign in (1, -1) for d, one in enumerate(bars)])
    extent = float((points.amax(0) - points.amin(0)).max())
    order = np.argsort(times)
    times, euler = times[order], steps[order].cumsum()
    ends = np.minimum(np.append(times[1:], np.inf), extent / 4)
    starts = np.maximum(times, spacing(points))
    is_there = ends > starts
    lengths = np.log(ends[is_there] / starts[is_there])
    return [(int(value), float(length)) for value, length in zip(euler[is_there], lengths, strict=True)]


def longest_plateau(found: list[tuple[int, float]]) -> int | None:
    """The even χ, as that of every closed surface is, which is held over the largest part of log α."""
    total: dict[int, float] = {}
    for value, length in found:
        if value % 2 == 0:
            total[value] = total.get(value, 0.0) + length
    return max(total, key=lambda value: total[value]) if total else None


def nearest_plateau(found: list[tuple[int, float]], euler: int) -> int | None:
    """The value nearest to the true χ among those held while α grows by 2 %: the best that picking an α can do."""
    held = [value for value, length in found if length > math.log(_HELD)]
    return min(held, key=lambda value: abs(value - euler)) if held else None
