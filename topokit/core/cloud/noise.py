"""Noise larger than the distances between points: fewer samples, moved onto the planes of wide neighborhoods.

The thickness of a neighborhood is the noise where it does not grow with the neighborhood: smaller ones are as thick as
they are wide, larger ones bend. Samples nearer to each other than the noise only repeat each other.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.guards import FEWEST_POINTS, fills_space
from topokit.core.cloud.nested_variances import nested_variances
from topokit.core.cloud.normals.double_sheets import double_share
from topokit.core.cloud.normals.patches import Patches, in_blocks, plane_axes
from topokit.core.cloud.sampling.downsampling import downsample
from topokit.core.cloud.settings import CloudSettings

_ROUNDS = 4  # of moving samples: those far off the surface have neighbors on one side of it; more gain nothing


class Noise(NamedTuple):
    """The noise of a cloud: its standard deviation, and the number of neighbors from which it was measured."""

    level: float
    neighbors: int


class Averaged(NamedTuple):
    """Evenly spread points of a noisy cloud, moved onto planes through its points.

    Attributes:
        points: (M, 3), where they are now.
        kept: (M,), their indices in the cloud.
        owner: (N,), the one that stands for each point of the cloud.
        blur: width of the details that were lost with the noise, in units of length.
    """

    points: Floats
    kept: Integers
    owner: Integers
    blur: float


def averaged(patches: Patches, settings: CloudSettings) -> Averaged | None:
    """Evenly spread points of a noisy cloud, moved onto planes through its points; None if there is no need.

    There is none if samples two standard deviations apart would not be fewer, if points are off their planes because
    two sheets are close together, or if they fill space.

    Args:
        patches: neighborhoods of N points.
        settings: of the noise, and the size up to which clouds are used whole.
    """
    points, own = patches.points, settings.noise
    noise = None if patches.roughness <= settings.signs.roughness else noise_of(patches, settings)
    if noise is None:
        return None
    radius = own.reach * noise.level
    within = float(np.median(patches.tree.query_ball_point(_probes(points, settings), radius, return_length=True)))
    n_apart = len(points) / within * (own.reach / own.apart) ** 2 * np.pi
    budget = int(np.clip(n_apart, FEWEST_POINTS, settings.sampling.whole))
    if budget >= len(points) or _is_no_noise(patches, noise, settings):
        return None
    kept, owner = downsample(points, budget, "even")
    n_neighbors = int(np.clip(within, own.sizes[0], own.sizes[-1]))
    moved = points[kept]
    for _ in range(_ROUNDS):
        moved = _on_planes(moved, patches.tree, n_neighbors)
    return Averaged(moved, kept, owner, own.apart * noise.level)


def noise_of(patches: Patches, settings: CloudSettings) -> Noise | None:
    """The distances of noisy points from their surface: the thickness of neighborhoods before it grows faster.

    Neighborhoods smaller than the noise are the thicker the wider they are. Those larger than it are as thick as it,
    until they are so wide that they bend or reach the other side of a wall. None if thickness grows as fast as the
    radius from the start: then the surface bends by more than its points are noisy. The noise must be larger than about
    a third of the spacing.
    """
    points = patches.points
    centers, sizes = _probes(points, settings), [size for size in settings.noise.sizes if size <= len(points)]
    distance, nearest = patches.tree.query(centers, sizes[-1])
    variance = np.maximum(nested_variances(points, nearest, sizes)[..., 0], np.finfo(np.float64).tiny)
    thickness = np.log(np.median(np.sqrt(variance), axis=1))
    radius = np.log(np.median(distance[:, np.array(sizes) - 1], axis=0))
    growth = np.diff(thickness) / np.diff(radius)
    faster = np.flatnonzero(np.diff(growth) > 0)
    at = faster[0] if len(faster) else len(growth) - 1
    return Noise(float(np.exp(thickness[at])), sizes[at]) if growth[at] < 1 else None


def _is_no_noise(patches: Patches, noise: Noise, settings: CloudSettings) -> bool:
    """Whether points are off their planes because there are two sheets, or because they fill space."""
    probes, own = settings.sampling.probes, settings.doubles
    own = replace(own, neighbors=max(noise.neighbors, own.neighbors))
    if double_share(patches, probes, own) > own.share:
        return True
    is_small = len(patches.points) < settings.guards.fewest_in_space  # larger clouds that fill space were refused
    return is_small and fills_space(patches.points, probes, settings.guards)


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
