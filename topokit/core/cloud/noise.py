"""Noise larger than the distances between points: fewer samples, moved onto the planes of wide neighborhoods.

The thickness of a neighborhood is the noise where it does not grow with the neighborhood: smaller ones are as thick as
they are wide, larger ones bend. Samples nearer to each other than the noise only repeat each other.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.guards import FEWEST_POINTS
from topokit.core.cloud.normals.patches import Patches, in_blocks, plane_axes
from topokit.core.cloud.sampling.downsampling import downsample
from topokit.core.cloud.settings import CloudSettings


def averaged(patches: Patches, settings: CloudSettings) -> tuple[Floats, Integers, Integers] | None:
    """Evenly spread points of a large noisy cloud, moved onto planes through its points; None if there is no need.

    All points of a small cloud are used where they are: there are too few to average.

    Args:
        patches: neighborhoods of N points.
        settings: of the noise, and the size up to which clouds are used whole.

    Returns:
        Positions (M, 3), the indices (M,) of these points, and for every point (N,) the one that stands for it.
    """
    points, own = patches.points, settings.noise
    if len(points) <= settings.sampling.whole or patches.roughness <= settings.signs.dense_roughness:
        return None
    radius = own.reach * noise_level(patches, settings)
    within = float(np.median(patches.tree.query_ball_point(_probes(points, settings), radius, return_length=True)))
    n_apart = len(points) / within * (own.reach / own.apart) ** 2 * np.pi
    budget = int(np.clip(n_apart, FEWEST_POINTS, settings.sampling.whole))
    kept, owner = downsample(points, budget, "even")
    n_neighbors = int(np.clip(within, own.sizes[0], own.sizes[-1]))
    moved = points[kept]
    for _ in range(2):  # the second one starts nearer to the surface
        moved = _on_planes(moved, patches.tree, n_neighbors)
    return moved, kept, owner


def noise_level(patches: Patches, settings: CloudSettings) -> float:
    """Standard deviation of noisy points from their surface: the thickness of neighborhoods before it grows faster.

    Small neighborhoods are the thicker the wider they are, until they are as thick as the noise; wide ones bend or
    reach the other side of a wall. The noise must be larger than about a third of the spacing: neighborhoods of clean
    points are as thick as they bend.
    """
    points = patches.points
    centers, sizes = _probes(points, settings), [size for size in settings.noise.sizes if size <= len(points)]
    index = patches.tree.query(centers, sizes[-1])[1]
    distance = np.linalg.norm(points[index] - centers[:, None], axis=2)
    thickness = np.log([np.median(plane_axes(points[index[:, :size]])[1]) for size in sizes])
    radius = np.log([np.median(distance[:, size - 1]) for size in sizes])
    growth = np.diff(thickness) / np.diff(radius)
    faster = np.flatnonzero(np.diff(growth) > 0)
    return float(np.exp(thickness[faster[0] if len(faster) else len(growth) - 1]))


def _probes(points: Floats, settings: CloudSettings) -> Floats:
    return points[:: max(len(points) // settings.sampling.probes, 1)]


def _on_planes(positions: Floats, tree: cKDTree, n_neighbors: int) -> Floats:
    moved = np.empty_like(positions)

    def move(rows: slice) -> None:
        patch = tree.data[tree.query(positions[rows], n_neighbors)[1]]
        axes, _ = plane_axes(patch)
        moved[rows] = positions[rows] + axes * ((patch.mean(1) - positions[rows]) * axes).sum(1, keepdims=True)

    in_blocks(move, len(positions))
    return moved
