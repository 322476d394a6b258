"""Clouds in which samples come in groups: several scans of one surface, or dense lines of one."""

from __future__ import annotations

import torch
from scipy.spatial import cKDTree

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.guards import FEWEST_POINTS
from topokit.core.cloud.normals.patches import Patches
from topokit.core.cloud.settings import SamplingSettings
from topokit.core.neighbors.kd_tree import nearest_in_tree
from topokit.core.separation import close_pairs, separate


def separate_samples(
    patches: Patches, normals: Floats | None, settings: SamplingSettings
) -> tuple[Integers, Integers] | None:
    """Points at least half a spacing apart from each other; None if the points may be independent as they are.

    Gaps between independent samples are small. Samples in groups leave gaps as large as if each group were one.

    Args:
        patches: neighborhoods of N points.
        normals: (N, 3), outward, or None; the two sides of a thin wall have opposite ones.
        settings: `crowd` and `probes`.

    Returns:
        The indices (M,) of the kept points, and for every point (N,) the position in them of the nearest one.
    """
    points, signed = torch.from_numpy(patches.points), None if normals is None else torch.from_numpy(normals)
    step = max(len(points) // settings.probes, 1)
    rows = torch.arange(0, len(points), step)
    around = torch.from_numpy(patches.neighbors[::step]).long()
    if len(close_pairs(points, rows, around, signed)[0]) <= settings.crowd * len(rows):
        return None
    kept = separate(points, torch.from_numpy(patches.neighbors).long(), signed).numpy()
    if not FEWEST_POINTS <= len(kept) < len(points):
        return None
    tree = cKDTree(patches.points[kept])
    return kept, nearest_in_tree(tree, patches.points, 1)
