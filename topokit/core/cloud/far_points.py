"""The few points of a cloud that lie absurdly far from all others: wrong coordinates, not surface."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from topokit.core.cloud.neighborhoods import FEWEST_POINTS

FAR = 30.0
"""Distance from the middle, over that within which nine tenths of the points lie, from which a point is far."""

_MOST = 0.01  # share of the points up to which far ones are errors rather than another part of the scene


@torch.no_grad()
def far_points(points: Tensor) -> Tensor:
    """Which points (N,) lie more than `FAR` times as far from the middle as nine tenths of them.

    None do if they are too many to be errors: more than 1 %, or enough to bound a solid of their own.

    Args:
        points: (N, 3), any float dtype and device.
    """
    middle = points.double().median(dim=0).values
    distance = (points.double() - middle).norm(dim=1)
    typical = distance.kthvalue(int(np.ceil(0.9 * len(points)))).values
    far = distance > FAR * typical
    count = int(far.sum())
    return far if typical > 0 and count < FEWEST_POINTS and count <= _MOST * len(points) else torch.zeros_like(far)
