"""Two sheets that look like one noisy sheet: heights above a curved patch that have two peaks.

Noise leaves heights with one peak. Where a wall or a gap is thinner than the sample spacing, both sheets may be given
the same outward direction, and all votes agree on the solid without it. Then the heights of neighbors whose normals
agree have two peaks: the excess kurtosis of two thin sheets is −2, that of Gaussian noise 0. A quadric takes the
bending of the surface out of the heights.

Reference:
    R. B. Darlington, "Is kurtosis really 'peakedness'?", The American Statistician 24(2), 1970,
    doi:10.1080/00031305.1970.10478885, for kurtosis as a measure of bimodality.
"""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Floats
from topokit.core.cloud.normals.patches import Patches
from topokit.core.cloud.settings import DoubleSettings

_TINY = 1e-300  # keeps quotients of lengths finite
_RIDGE = 1e-9  # of the normal equations, in units of the patch: neighbors may lie on a line


def double_share(patches: Patches, probes: int, settings: DoubleSettings, outward: Floats | None = None) -> float:
    """Share of the neighborhoods, from 0 to 1, whose points look like two sheets.

    Args:
        patches: neighborhoods of N points, which are in the order of a curve.
        probes: number of neighborhoods, at most.
        settings: of the test.
        outward: (N, 3), unit normals; neighbors count if theirs agree. All do if normals are not known.
    """
    n_points = len(patches.points)
    at = np.arange(0, n_points, -(-n_points // probes))
    distance, index = patches.tree.query(patches.points[at], min(settings.neighbors, n_points))
    agree = np.ones(index.shape)
    if outward is not None:
        cosine = np.einsum("nka,na->nk", outward[index], outward[at])
        agree = (cosine > patches.settings.refit_cosine).astype(np.float64)
    count = agree.sum(1)
    enough = count >= settings.neighbors / 2
    agree, count = agree[enough], count[enough]
    height = _heights(patches.points[index[enough]], agree)
    squared = (agree * height**2).sum(1) / count
    kurtosis = (agree * height**4).sum(1) / count / np.maximum(squared**2, _TINY) - 3
    disc = np.pi * distance[enough, patches.settings.graph] ** 2 / patches.settings.graph
    is_double = (squared > settings.thick**2 * disc) & (kurtosis < -settings.two_peaks)
    return float(is_double.sum() / len(at))


def _heights(patches: Floats, weights: Floats) -> Floats:
    """Heights (n, k) of points (n, k, 3) above the quadric that fits those of weight 1, of weights (n, k), best."""
    share = (weights / weights.sum(1, keepdims=True))[:, :, None]
    patches = patches - (share * patches).sum(1, keepdims=True)
    axes = np.linalg.eigh((share * patches).transpose(0, 2, 1) @ patches)[1]
    height, u, v = np.moveaxis(patches @ axes, 2, 0)
    size = np.sqrt((share[:, :, 0] * (u**2 + v**2)).sum(1, keepdims=True)) + _TINY
    u, v = u / size, v / size
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2)
    weighted = (share * terms).transpose(0, 2, 1)
    coefficients = np.linalg.solve(weighted @ terms + _RIDGE * np.eye(6), weighted @ height[:, :, None])
    return np.asarray(height - (terms @ coefficients)[:, :, 0])
