"""How many neighbors curvature takes by default: 20 on clean samples, more where noise would drown it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.local.curvature import DEFAULT_NEIGHBORS
from topokit.core.local.quadric import TERMS, fit_quadrics

_SIZES = (20, 28, 40, 57, 80, 113, 160, 226, 320)  # numbers of neighbors that are tried, √2 apart
_PROBES = 400  # neighborhoods that are measured, evenly spread over the rows: medians within about 5 %
# That of the Weingarten map over as many neighbors is 2.5 times smaller. With this limit the error of K on ellipsoid
# and torus at 0.25 % to 1 % noise is within a factor of 1.4 of the least over all k (docs/paper-tables.md).
_NOISE = 0.15  # largest standard error of a quadric's curvature, as a share of it
# Noise is everywhere, while edges and corners, which quadrics do not fit either, leave some neighborhoods alone.
_QUIETEST = 0.1  # share of the neighborhoods, the quietest, that gives the noise
_TWO_SHEETS = 2.2  # median kurtosis of heights below which they are those of two sheets: 1 for thin ones, 3 for noise
_ENOUGH = 40  # neighbors from which kurtosis is measured: the fit to fewer takes up the tails
_REACH = 1.0  # radius of a neighborhood times the curvature from which a quadric no longer describes it
_FLAT = 0.01  # noise in sample spacings that is taken for none, however flat the surface


def given_or_default(n_neighbors: int | None) -> int:
    """The number of neighbors itself, or 20 for None."""
    return DEFAULT_NEIGHBORS if n_neighbors is None else n_neighbors


@torch.no_grad()
def automatic_neighbors(points: Tensor, neighbors: Tensor) -> int:
    """Number of neighbors that the noise of samples calls for; 20 where they are clean.

    Quadrics are fitted to some hundred neighborhoods. What lies off them, in the quietest tenth, is noise: curved
    surfaces lie on their quadrics, and sharp edges and thin walls are not everywhere. The noise gives the standard
    error of the quadrics' second derivatives; the size of these, less that error, is the curvature. The answer is the
    smallest of nine numbers from 20 to 320 for which this error is at most 15 % of the median curvature; but none whose
    neighborhoods reach farther than the radius of curvature, or hold more than an eighth of the points, and 20 where
    most neighborhoods consist of two sheets.

    Args:
        points: (..., N, 3), any float dtype and device. Items of a batch are judged together.
        neighbors: (..., N, k ≥ 3) indices within each item, nearest first; searched anew only beyond their k.

    Returns:
        One number for the whole batch. It depends on nothing but the samples' positions, and not on their scale.
    """
    items = points.detach().reshape(-1, *points.shape[-2:]).double().cpu()
    known = neighbors.reshape(-1, *neighbors.shape[-2:]).cpu()
    n_points = items.shape[1]
    rows = torch.arange(0, n_points, max(1, n_points * len(items) // _PROBES))
    chosen = least = min(DEFAULT_NEIGHBORS, n_points - 1)
    for size in (size for size in _SIZES if 8 * size <= n_points):
        index = known[:, rows, :size] if size <= known.shape[-1] else _nearest(items, rows, size)
        found = _probe(torch.cat([item[near] - item[rows, None] for item, near in zip(items, index, strict=True)]))
        if size >= _ENOUGH and found.kurtosis < _TWO_SHEETS:
            return least
        if size > least and found.reach > _REACH:
            return chosen
        chosen = size
        if found.noise <= _FLAT or found.error <= _NOISE * found.curvature:
            return chosen
    return chosen


@dataclass(frozen=True)
class _Probe:
    """What neighborhoods of one size show; medians unless stated otherwise.

    Attributes:
        curvature: root of κ₁² + κ₂², in 1/length.
        error: its standard error, in 1/length.
        noise: distance from the quadrics, in sample spacings, of the quietest tenth.
        reach: radius times curvature.
        kurtosis: of the distances from the quadrics.
    """

    curvature: float
    error: float
    noise: float
    reach: float
    kurtosis: float


def _probe(offsets: Tensor) -> _Probe:
    """Fit quadrics to neighborhoods (m, k, 3), neighbors minus center."""
    fit = fit_quadrics(offsets)
    weights = offsets.new_tensor((0, 0, 0, 1, 2, 1))  # κ₁² + κ₂² = f_xx² + 2 f_xy² + f_yy²
    radius = fit.radius[:, 0, 0].where(fit.radius[:, 0, 0] > 0, torch.inf)  # coinciding points are flat
    spread = fit.inverse.diagonal(dim1=-2, dim2=-1) @ weights
    squares = fit.residual.square()
    variance = squares.sum(-1) / (fit.n_used - TERMS).clamp(min=1)
    total = (fit.coefficients.square() @ weights - variance * spread) / radius.square()
    kurtosis = fit.n_used * squares.square().sum(-1) / squares.sum(-1).square()
    noise = (variance.sqrt() * radius).nan_to_num(0.0).quantile(_QUIETEST)
    curvature = float(total.median().clamp(min=0).sqrt())
    spacing = (torch.pi / offsets.shape[1]) ** 0.5 * radius.median()
    error = noise * (spread.sqrt() / radius.square()).median()
    reach = curvature * float(radius.median())
    return _Probe(curvature, float(error), float(noise / spacing), reach, float(kurtosis.nanmedian()))


def _nearest(items: Tensor, rows: Tensor, size: int) -> Tensor:
    """Neighbors (B, m, size) of some rows of every item; the row itself is the nearest and left out."""
    found = [cKDTree(item.numpy()).query(item[rows].numpy(), size + 1)[1][:, 1:] for item in items]
    return torch.stack([torch.from_numpy(one) for one in found])
