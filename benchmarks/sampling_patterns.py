"""Four solids, and the ways in which scanners and programs sample a surface.

No sampling here was used to fit the confidence but random, farthest and uneven points.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import numpy as np
import trimesh
from confidence import farthest
from numpy.typing import NDArray
from planted import at
from scale_truth import raycaster
from scipy.spatial.transform import Rotation
from skimage.measure import marching_cubes
from trimesh.creation import annulus, box, cylinder, torus
from trimesh.intersections import mesh_multiplane

from topokit.testing.meshes import genus_mesh

Floats = NDArray[np.float64]
Draw = np.random.Generator

N_POINTS = 10_000


def drilled_plate() -> trimesh.Trimesh:
    places = [(x, y) for x in (-0.35, 0.35) for y in (-0.2, 0.2)] + [(0.0, 0.0)]
    holes = [cylinder(0.07, 1, sections=48, transform=at(x, y, 0)) for x, y in places]
    return trimesh.boolean.difference([box((1.0, 0.7, 0.15)), *holes], engine="manifold")


def chair() -> trimesh.Trimesh:
    legs = [box((0.08, 0.08, 0.5), transform=at(x, y, -0.25)) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]
    posts = [box((0.07, 0.07, 0.5), transform=at(x, 0.2, 0.25)) for x in (-0.2, 0.0, 0.2)]
    rails = [box((0.5, 0.5, 0.08)), box((0.5, 0.08, 0.1), transform=at(0, 0.2, 0.5))]
    return trimesh.boolean.union([*legs, *posts, *rails], engine="manifold")


def mug() -> trimesh.Trimesh:
    cup = annulus(0.27, 0.35, 0.8, sections=96)
    floor = cylinder(0.34, 0.08, sections=96, transform=at(0, 0, -0.36))
    handle = torus(0.2, 0.05, 64, 24, transform=at(0, -0.42, 0) @ turned(np.pi / 2, (0, 1, 0)))
    outside = cylinder(0.31, 0.7, sections=96)
    handle = trimesh.boolean.difference([handle, outside], engine="manifold")
    return trimesh.boolean.union([cup, floor, handle], engine="manifold")


def turned(angle: float, axis: Sequence[float]) -> Floats:
    """The matrix (4, 4) of a turn about an axis through the origin, in radians."""
    return np.asarray(trimesh.transformations.rotation_matrix(angle, axis))


@functools.cache
def solids() -> dict[str, trimesh.Trimesh]:
    """The four solids, by name; their Euler characteristics are -2, -8, -2 and 0."""
    double_torus = trimesh.Trimesh(*genus_mesh(2), process=False)
    return {"double torus": double_torus, "drilled plate": drilled_plate(), "chair": chair(), "mug": mug()}


def samples_of(mesh: trimesh.Trimesh, count: int, draw: Draw) -> Floats:
    """Independent points (count, 3) of a mesh."""
    points, _ = trimesh.sample.sample_surface(mesh, count, seed=int(draw.integers(2**31)))
    return np.asarray(points, dtype=np.float64)


def _length(points: Floats) -> float:
    return float(np.ptp(points, axis=0).max())


def noisy(points: Floats, share: float, draw: Draw) -> Floats:
    """Points with Gaussian noise of a share of the longest side."""
    return points + draw.normal(size=points.shape) * share * _length(points)


def random_points(count: int, noise: float) -> Callable[[trimesh.Trimesh, Draw], Floats]:
    return lambda mesh, draw: noisy(samples_of(mesh, count, draw), noise, draw)


def farthest_points(count: int) -> Callable[[trimesh.Trimesh, Draw], Floats]:
    def pick(mesh: trimesh.Trimesh, draw: Draw) -> Floats:
        many = samples_of(mesh, 4 * count, draw)
        return many[farthest(many, count, draw)]

    return pick


def lidar(noise: float) -> Callable[[trimesh.Trimesh, Draw], Floats]:
    """Fourteen stations around a solid, rays along lines of equal elevation, with noise along each ray."""

    def scan(mesh: trimesh.Trimesh, draw: Draw) -> Floats:
        scene, length = raycaster(mesh), _length(mesh.vertices)
        corners = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T / np.sqrt(3)
        stations = np.concatenate((corners, np.eye(3), -np.eye(3))) @ Rotation.random(rng=draw).as_matrix()
        angles = np.deg2rad(np.arange(-14, 14, 0.35))
        east, up = np.meshgrid(angles, np.deg2rad(np.arange(-14, 14, 0.7)))
        rays = np.stack((np.cos(up) * np.cos(east), np.cos(up) * np.sin(east), np.sin(up)), -1).reshape(-1, 3)
        found = []
        for place in stations:
            frame = np.linalg.qr(np.column_stack((-place, draw.normal(size=(3, 2)))))[0]
            frame[:, 0] *= np.sign(frame[:, 0] @ -place)
            way = rays @ frame.T
            start = mesh.bounds.mean(0) + 3 * length * place
            hit = scene.cast_rays(np.float32(np.hstack((np.broadcast_to(start, way.shape), way))))["t_hit"].numpy()
            seen = np.isfinite(hit)
            distance = hit[seen] + draw.normal(size=int(seen.sum())) * noise * length
            found.append(start + distance[:, None] * way[seen])
        return np.concatenate(found)

    return scan


def photogrammetry(mesh: trimesh.Trimesh, draw: Draw) -> Floats:
    """Eight times fewer points at one end, noise of 0.2 %, and six clusters of stray points."""
    many = samples_of(mesh, 4 * N_POINTS, draw)
    height = many @ Rotation.random(rng=draw).as_matrix()[0]
    density = np.exp(-2 * (height - height.min()) / np.ptp(height))
    points = many[draw.choice(len(many), N_POINTS, replace=False, p=density / density.sum())]
    low, high = points.min(0), points.max(0)
    centers = draw.uniform(low - 0.2 * (high - low), high + 0.2 * (high - low), (6, 1, 3))
    strays = centers + 0.01 * _length(points) * draw.normal(size=(6, 30, 3))
    return np.concatenate((noisy(points, 0.002, draw), strays.reshape(-1, 3)))


def cell_centroids(mesh: trimesh.Trimesh, draw: Draw) -> Floats:
    """The mean of the points in each cell of a grid, as viewers downsample."""
    points = samples_of(mesh, 10 * N_POINTS, draw)
    _, cell = np.unique(np.floor(points / np.sqrt(mesh.area / 6000)), axis=0, return_inverse=True)
    count = np.bincount(cell.ravel())
    return np.stack([np.bincount(cell.ravel(), points[:, k]) / count for k in range(3)], 1)


def quantized(mesh: trimesh.Trimesh, draw: Draw) -> Floats:
    """Rounded to a grid of 96 cells along the longest side."""
    points = samples_of(mesh, N_POINTS, draw)
    cell = _length(points) / 96
    return np.asarray(np.unique(np.round(points / cell), axis=0) * cell)


def contours(mesh: trimesh.Trimesh, draw: Draw) -> Floats:
    """Outlines in 60 parallel planes, as from computed tomography; points are as dense along them as across."""
    normal = Rotation.random(rng=draw).as_matrix()[0]
    height = mesh.vertices @ normal
    step = np.ptp(height) / 60
    lines, frames, _ = mesh_multiplane(mesh, normal * height.min(), normal, step * (np.arange(60) + 0.5))
    found = []
    for segments, frame in zip(lines, frames, strict=True):
        along = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
        chosen = draw.choice(len(segments), int(np.ceil(along.sum() / step)), p=along / along.sum())
        share = draw.random((len(chosen), 1))
        flat = segments[chosen, 0] * (1 - share) + segments[chosen, 1] * share
        found.append(trimesh.transformations.transform_points(np.pad(flat, ((0, 0), (0, 1))), frame))
    return np.concatenate(found)


def with_outliers(mesh: trimesh.Trimesh, draw: Draw) -> Floats:
    """One point in twenty anywhere in a box 1.5 times as large."""
    points = samples_of(mesh, N_POINTS, draw)
    middle, half = (points.min(0) + points.max(0)) / 2, 0.75 * np.ptp(points, axis=0)
    return np.concatenate((points, draw.uniform(middle - half, middle + half, (N_POINTS // 20, 3))))


def filled_in_part(mesh: trimesh.Trimesh, draw: Draw) -> Floats:
    """One point in ten in the interior."""
    anywhere = draw.uniform(*mesh.bounds, (10 * N_POINTS, 3))
    is_inside = raycaster(mesh).compute_occupancy(np.float32(anywhere)).numpy() > 0
    return np.concatenate((samples_of(mesh, N_POINTS, draw), anywhere[is_inside][: N_POINTS // 10]))


def repeated(mesh: trimesh.Trimesh, draw: Draw) -> Floats:
    """Every point five times, a millionth apart."""
    return noisy(np.repeat(samples_of(mesh, N_POINTS // 2, draw), 5, axis=0), 1e-6, draw)


def misregistered(mesh: trimesh.Trimesh, draw: Draw) -> Floats:
    """Two scans, one of them shifted by 0.3 % and turned by 0.2 degrees."""
    points = samples_of(mesh, 2 * N_POINTS, draw)
    turn = Rotation.from_rotvec(np.deg2rad(0.2) * np.eye(3)[0])
    points[N_POINTS:] = turn.apply(points[N_POINTS:]) + 0.003 * _length(points) * np.eye(3)[1]
    return points


def two_densities(ratio: int) -> Callable[[trimesh.Trimesh, Draw], Floats]:
    """2 500 points on one half, so many times as many on the other."""

    def pick(mesh: trimesh.Trimesh, draw: Draw) -> Floats:
        points = samples_of(mesh, ratio * N_POINTS // 2, draw)
        is_dense, is_rare = points[:, 0] > np.median(points[:, 0]), draw.random(len(points)) < 1 / ratio
        return points[is_dense | is_rare]

    return pick


def grid_vertices(mesh: trimesh.Trimesh, draw: Draw) -> Floats:
    """Vertices of marching cubes on a grid of 80 cells along the longest side."""
    cell = _length(mesh.vertices) / 80
    low = mesh.bounds[0] - (3 + draw.random(3)) * cell
    shape = np.ceil((mesh.bounds[1] + 3 * cell - low) / cell).astype(int)
    grid = low + cell * np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1)
    distance = raycaster(mesh).compute_signed_distance(np.float32(grid)).numpy()
    return np.asarray(marching_cubes(distance, 0.0)[0] * cell + low)


PATTERNS: dict[str, Callable[[trimesh.Trimesh, Draw], Floats]] = {
    "random": random_points(N_POINTS, 0.0),
    "farthest 1 024": farthest_points(1024),
    "farthest 2 048": farthest_points(2048),
    "farthest 4 096": farthest_points(4096),
    "lidar, noise 0.05 %": lidar(0.0005),
    "lidar, noise 0.3 %": lidar(0.003),
    "photogrammetry": photogrammetry,
    "means of cells": cell_centroids,
    "rounded to 96 cells": quantized,
    "contours": contours,
    "vertices of marching cubes": grid_vertices,
    "outliers 5 %": with_outliers,
    "10 % inside": filled_in_part,
    "repeated five times": repeated,
    "two scans, shifted 0.3 %": misregistered,
    "density 1 : 4": two_densities(4),
    "density 1 : 10": two_densities(10),
    "density 1 : 40": two_densities(40),
    "noise 1 %": random_points(N_POINTS, 0.01),
    "noise 2 %": random_points(N_POINTS, 0.02),
    "noise 1 %, 60 000": random_points(60_000, 0.01),
    "noise 2 %, 60 000": random_points(60_000, 0.02),
}
