"""Points off the surface that the others are samples of: outliers.

The neighborhood of an outlier is wider than those of the points next to it, which are of the surface, and it lies
beside the plane of its neighbors; among other outliers neighborhoods are wide and round. What is found is removed, and
the rest is looked at again: outliers hide each other.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.arrays import Booleans, Floats, Integers
from topokit.core.cloud.guards import FEWEST_POINTS
from topokit.core.cloud.settings import OutlierSettings
from topokit.core.neighbors.kd_tree import nearest_in_tree, without_many_copies

_NEIGHBORS = 12  # of the plane beside which an outlier lies
_WIDTH = 8  # the distance to so many neighbors is the width of a neighborhood
_ROUNDS = 4  # of removal; more find nothing new
_ROWS = 1 << 17  # points whose neighbors are looked up at once, to bound memory
_MOST = 0.5  # share of points; if more seem to be outliers, there is no surface among them


@torch.no_grad()
def outliers(points: Tensor, settings: OutlierSettings | None = None) -> Tensor:
    """Which points (N,) are outliers; none if there are fewer than 32 points, or if most would be.

    Args:
        points: (N, 3), finite, any float dtype and device.
        settings: by default the usual ones.
    """
    settings = settings or OutlierSettings()
    positions = np.ascontiguousarray(points.detach().cpu().double().numpy())
    kept = np.arange(len(positions))
    for _ in range(_ROUNDS):
        if len(kept) < FEWEST_POINTS:
            break
        found = _outliers_among(positions[kept], settings)
        kept = kept[~found]
        if not found.any():
            break
    is_out = np.ones(len(positions), dtype=bool)
    is_out[kept] = False
    if is_out.mean() > _MOST or len(kept) < FEWEST_POINTS:
        is_out[:] = False
    return torch.from_numpy(is_out).to(points.device)


def _outliers_among(points: Floats, settings: OutlierSettings) -> Booleans:
    """Which points (N, 3) are outliers as long as all others are in place."""
    apart = without_many_copies(points, _NEIGHBORS + 1)
    tree = cKDTree(points[apart], balanced_tree=False, compact_nodes=False)
    widths, around = np.empty(len(points)), np.empty((len(points), _WIDTH), dtype=np.int32)
    for rows in np.array_split(np.arange(len(points)), -(-len(points) // _ROWS)):
        around[rows] = apart[nearest_in_tree(tree, points[rows], _WIDTH + 1)[:, 1:]]
        widths[rows] = np.linalg.norm(points[around[rows, -1]] - points[rows], axis=1)
    typical = np.median(widths)
    isolation = widths / np.maximum(np.median(widths[around], axis=1), np.finfo(float).tiny)
    is_isolated, is_wide = isolation > settings.isolated, widths > settings.wide * typical
    is_found = is_isolated & (widths > settings.sparse * typical)
    unclear = np.flatnonzero((is_isolated | is_wide) & ~is_found)
    beside, roundness = _planes(points, unclear, tree)
    is_found[unclear] |= is_isolated[unclear] & (beside > settings.beside * widths[unclear])
    is_found[unclear] |= is_wide[unclear] & (roundness > settings.round)
    return is_found


def _planes(points: Floats, rows: Integers, tree: cKDTree) -> tuple[Floats, Floats]:
    """Distances (M,) of some points from the planes of their neighbors, and the roundness (M,) of these neighbors."""
    if len(rows) == 0:
        return np.empty(0), np.empty(0)
    patch = tree.data[nearest_in_tree(tree, points[rows], min(_NEIGHBORS + 1, tree.n))[:, 1:]]
    middle = patch.mean(1)
    patch = patch - middle[:, None]
    variance, axes = np.linalg.eigh(np.einsum("mka,mkb->mab", patch, patch))
    beside = np.abs(((points[rows] - middle) * axes[:, :, 0]).sum(1))
    return beside, np.sqrt(np.maximum(variance[:, 0], 0) / np.maximum(variance[:, 2], np.finfo(float).tiny))
