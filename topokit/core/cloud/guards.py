"""What no surface can be read from: points in a plane, points that fill space, strays, and rounded coordinates."""

from __future__ import annotations

import math

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.arrays import Floats
from topokit.core.cloud.nested_variances import nested_variances
from topokit.core.cloud.settings import GuardSettings
from topokit.errors import InputError

_FLAT = 1e-6  # thickness of a cloud over its length up to which rounding alone may lift it off a plane

FEWEST_POINTS = 32
"""Smallest number of samples for which a solid is looked for."""


def centered_positions(points: Floats) -> tuple[Floats, float]:
    """Positions around the origin, in units of a power of two near the longest side of their box, and that unit.

    Single precision loses the shape's digits far from the origin. Whole units are subtracted, so a cloud around the
    origin is unchanged to the last digit.

    Args:
        points: (N, 3).

    Raises:
        InputError: for the wrong shape, fewer than 32 points, values that are not finite, or points that lie in a
            plane, on a line or in one place.
    """
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"a cloud has shape (N, 3), not {points.shape}.")
    if len(points) < FEWEST_POINTS:
        raise InputError(f"{len(points)} points are too few to bound a solid: at least {FEWEST_POINTS} are needed.")
    if not np.isfinite(points).all():
        raise InputError("some coordinates are not finite: remove those points.")
    low, high = points.min(0), points.max(0)
    longest = float((high - low).max())
    if not np.isfinite(longest) or longest <= 0:
        raise InputError("the points all coincide, or their extent overflows: they bound no solid.")
    unit_length = float(2.0 ** np.floor(np.log2(longest)))
    middle = np.round((low / 2 + high / 2) / unit_length) * unit_length
    positions = (points - middle) / unit_length
    if is_flat(positions):
        raise InputError("the points lie in a plane or on a line: they bound no solid.")
    return positions, unit_length


def is_flat(points: Floats) -> bool:
    """Whether points (N, 3) lie in a plane, on a line or in one place."""
    variance = np.linalg.eigvalsh(np.cov(points, rowvar=False))
    return bool(variance[0] <= _FLAT**2 * variance[2])


def refuse_filled_space(points: Floats, probes: int, settings: GuardSettings) -> None:
    """Refuse points (N, 3) that fill space: a blob, a lattice or plain noise. See `fills_space`.

    With few points noise, walls and space cannot be told apart.

    Raises:
        InputError: if at least 10 000 points fill space.
    """
    if len(points) >= settings.fewest_in_space and fills_space(points, probes, settings):
        raise InputError(
            f"the {len(points)} points fill space: neighborhoods of all sizes are as thick as they are wide, so they "
            "lie on no surface."
        )


def fills_space(points: Floats, probes: int, settings: GuardSettings) -> bool:
    """Whether neighborhoods of points (N, 3) are round at all scales, or there are fewer points than probes to see it.

    Around a point of a surface the neighbors lie near a plane. On a noisy surface this shows only in neighborhoods
    wider than the noise, on one with many thin walls only in small ones.

    Args:
        points: as above.
        probes: number of neighborhoods of each size.
        settings: of the limits.
    """
    return least_roundness(points, probes, settings) > settings.round


def least_roundness(points: Floats, probes: int, settings: GuardSettings) -> float:
    """The median ratio of the smallest to the largest extent of neighborhoods (N, 3), at the scale where it is least.

    The extents are standard deviations along the principal axes: 0 in a plane, 1 in a large ball. Copies with fewer
    points make wider neighborhoods, so that those of the last copy are as wide for a dense cloud as for a sparse one.
    1 if there are fewer points than probes.
    """
    if len(points) < probes:
        return 1.0
    sizes = settings.round_sizes
    n_copies = 1 + math.ceil(math.log(len(points) / probes) / math.log(sizes[-1] / sizes[0]))
    order = np.random.default_rng(0).permutation(len(points))
    found = []
    for n_points in np.geomspace(len(points), probes, n_copies).round().astype(int):
        copy = points[order[:n_points]]
        tree = cKDTree(copy, balanced_tree=False, compact_nodes=False)
        nearest = tree.query(copy[:probes], sizes[-1])[1]
        variance = nested_variances(copy, nearest, sizes)
        roundness = np.sqrt(variance[..., 0] / np.maximum(variance[..., 2], np.finfo(np.float64).tiny))
        found += np.median(roundness, axis=1).tolist()
    return min(found)


@torch.no_grad()
def far_points(points: Tensor, settings: GuardSettings | None = None) -> Tensor:
    """Which points (N,) lie 30 times as far from the middle as nine tenths of them: wrong coordinates, not surface.

    None do if they are enough to bound a solid of their own.

    Args:
        points: (N, 3), any float dtype and device.
        settings: by default the usual ones.
    """
    settings = settings or GuardSettings()
    middle = points.double().median(dim=0).values
    distance = (points.double() - middle).norm(dim=1)
    typical = distance.kthvalue(int(np.ceil(0.9 * len(points)))).values
    far = distance > settings.far * typical
    count = int(far.sum())
    is_error = typical > 0 and count < FEWEST_POINTS
    return far if is_error else torch.zeros_like(far)


@torch.no_grad()
def single_precision_step(points: Tensor) -> float:
    """Distance between neighboring single-precision numbers at the largest coordinate of points (N, 3).

    It is 0 if the coordinates have more digits than that, so that they never were in single precision.
    """
    largest = float(points.abs().max())
    if largest == 0 or not torch.equal(points.float().to(points.dtype), points):
        return 0.0
    return math.ldexp(torch.finfo(torch.float32).eps, math.frexp(largest)[1] - 1)
