"""A second reading of an open cloud: the union of balls around its samples, which needs neither normals nor rims.

From the radius that closes the gaps between samples to the radius that closes the narrowest hole or gap of the surface,
the union has the surface's homotopy type, whether that is closed, open or not orientable.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from topokit.core.cloud.guards import FEWEST_POINTS
from topokit.core.cloud.sampling.copies import distinct
from topokit.core.cloud.sampling.downsampling import downsample
from topokit.core.cloud.settings import WireSettings
from topokit.core.cloud.solid.alpha import union_of_balls
from topokit.core.labels import count_distinct
from topokit.core.separation import SPACED, separate


@dataclass(frozen=True, eq=False)
class SheetReading:
    """The union of balls around the samples of a surface.

    Attributes:
        shares: for each Euler characteristic of the union the share of the radii, by weight, for which it stands, from
            the largest share on.
        components: connected parts, at a middle radius.
        closed: cavities there: parts that enclose space.
    """

    shares: Mapping[int, float]
    components: int
    closed: int


@torch.no_grad()
def read_sheet(points: Tensor, neighbors: Tensor, settings: WireSettings) -> SheetReading | None:
    """The reading of a cloud as a surface with or without boundary; None for fewer than 32 separate samples.

    Args:
        points: (N, 3), any float dtype and device.
        neighbors: (N, k) indices of the nearest neighbors, nearest first.
        settings: see there.
    """
    samples = points[separate(points, neighbors)].cpu().double().numpy()
    samples = samples[distinct(samples)[0]]
    samples = samples[downsample(samples, settings.samples, "even")[0]]
    if len(samples) < FEWEST_POINTS:
        return None
    eighth = cKDTree(samples).query(samples, [SPACED + 1])[0]
    spacing = float(np.median(eighth)) * float(np.sqrt(np.pi / SPACED))
    balls = union_of_balls(samples, spacing)
    smallest, largest = (radius * spacing for radius in settings.open_radii)
    _, eulers, weights = balls.euler_weights(smallest, largest)
    values, index = np.unique(eulers, return_inverse=True)
    share = np.bincount(index, weights) / weights.sum()
    shares = {int(values[rank]): float(share[rank]) for rank in np.argsort(-share, kind="stable")}
    component, closed = balls.parts(float(np.sqrt(smallest * largest)))
    return SheetReading(shares, count_distinct(component), closed)
