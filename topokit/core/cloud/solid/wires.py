"""A third reading of a cloud: the boundary of a thickened graph, for wires and tubes too thin to show their walls.

Where a tube's radius is about one sample spacing, its wall cannot be told from its inside, but its homotopy type can:
the union of balls around the samples is the solid, from the radius that closes all gaps along the wire to the radius
that first joins two wires. The Euler characteristic that holds over most of these radii is the solid's; that of its
surface is twice that. Only clouds that look one-dimensional everywhere are read in this way.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import Delaunay, cKDTree

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.guards import FEWEST_POINTS
from topokit.core.cloud.nested_variances import nested_variances
from topokit.core.cloud.normals.patches import unit
from topokit.core.cloud.sampling.downsampling import downsample
from topokit.core.cloud.settings import WireSettings
from topokit.core.cloud.solid.alpha import AlphaComplex, union_of_balls
from topokit.core.labels import connected_labels, count_distinct
from topokit.core.neighbors import nearest_neighbors

_PROBES = 1000  # neighborhoods that are tested
_FEW = 500  # points of which the tetrahedra are counted first
_MOST_TETRAHEDRA = (
    20  # per point; wires of any thickness have up to 11, two linked circles without any as many as N / 6
)
_STEPS = 8  # neighbors that connect a part, and whose disc is the area of that many points


@dataclass(frozen=True, eq=False)
class WireReading:
    """A cloud read as the boundary of a thickened graph; lengths in units of the sample spacing.

    Attributes:
        euler: Euler characteristic of the surface, twice that of the union of balls.
        components: connected parts.
        share: of the weight of all radii between one and six spacings, the part over which the integer stands; small
            radii weigh more, as 1 / radius².
        contrast: that share over the share of the next integer.
        smallest, largest: the radii between which the integer stands.
        narrowness: median ratio of the second to the first variance of the largest neighborhoods; zero for a curve.
        n_stray: points left out because they are far from all others.
        normals: (N, 3), unit, away from the local center line; zero on it.
        seconds: time that the reading took.
    """

    euler: int
    components: int
    share: float
    contrast: float
    smallest: float
    largest: float
    narrowness: float
    n_stray: int
    normals: Floats
    seconds: float


def read_wire(points: Floats, tree: cKDTree, settings: WireSettings) -> tuple[WireReading, Integers, Integers] | None:
    """The reading of a cloud as wires; None if its neighborhoods are not one-dimensional or its balls hold cavities.

    Args:
        points: (N, 3), distinct, not in a plane.
        tree: of the points.
        settings: see there.

    Returns:
        The reading of evenly spread points, their indices (M,), and for every point (N,) the one that stands for it.
    """
    if min(segment_narrowness(points, tree, settings), default=1.0) > settings.narrow:
        return None
    kept, owner = downsample(points, _affordable(points, settings), "even")
    reading = _read(points[kept], settings)
    return None if reading is None else (reading, kept, owner)


def _affordable(points: Floats, settings: WireSettings) -> int:
    """How many samples are read: few of curves without thickness, whose tetrahedra are as many as pairs of points."""
    few = downsample(points, _FEW, "even")[0]
    is_dense = len(Delaunay(points[few], qhull_options="QJ").simplices) > _MOST_TETRAHEDRA * len(few)
    return min(settings.samples, 2 * _FEW) if is_dense else settings.samples


def _read(points: Floats, settings: WireSettings) -> WireReading | None:
    started = time.perf_counter()
    narrowness = segment_narrowness(points, cKDTree(points), settings)
    if min(narrowness, default=1.0) > settings.narrow:
        return None
    kept, spacing = _without_stray_points(points, settings)
    if len(kept) < FEWEST_POINTS:
        return None
    balls = union_of_balls(points[kept], spacing)
    euler, share, contrast, (smallest, largest) = _lasting_euler(balls, spacing, settings)
    component, cavities = balls.parts(float(np.sqrt(smallest * largest)) * spacing)
    components = count_distinct(component)
    if cavities > 0 or euler > components:
        return None
    return WireReading(
        euler=2 * euler,
        components=components,
        share=share,
        contrast=contrast,
        smallest=smallest,
        largest=largest,
        narrowness=narrowness[-1],
        n_stray=len(points) - len(kept),
        normals=_away_from_center_line(points, settings),
        seconds=time.perf_counter() - started,
    )


def segment_narrowness(points: Floats, tree: cKDTree, settings: WireSettings) -> tuple[float, ...]:
    """Median ratio of the second to the first variance of neighborhoods of 25, 50 and 100 points.

    Sizes of which the cloud (N, 3) does not hold twenty are left out, so the tuple is empty for N < 500.

    Args:
        points: (N, 3).
        tree: of the points.
        settings: of the sizes.
    """
    sizes = [size for size in settings.sizes if size * settings.fewest_patches <= len(points)]
    if not sizes:
        return ()
    probes = points[:: max(1, len(points) // _PROBES)]
    nearest = tree.query(probes, sizes[-1] + 1)[1]
    variance = nested_variances(points, nearest, [size + 1 for size in sizes])
    return tuple(np.median(variance[..., 1] / np.maximum(variance[..., 2], np.finfo(np.float64).tiny), axis=1).tolist())


def _without_stray_points(points: Floats, settings: WireSettings) -> tuple[Integers, float]:
    """Indices of the points whose part of the neighbor graph is more than clutter, and the sample spacing.

    The spacing is √(median area per point), from the eighth neighbor; unlike the mean, it ignores stray points.
    """
    nearest = nearest_neighbors(torch.from_numpy(points), _STEPS).numpy()
    distance = np.linalg.norm(points[nearest] - points[:, None], axis=2)
    spacing = float(np.median(distance[:, -1]) * np.sqrt(np.pi / _STEPS))
    point, rank = np.nonzero(distance < settings.largest * spacing)
    part = connected_labels(len(points), point, nearest[point, rank])
    return np.flatnonzero(np.bincount(part)[part] >= FEWEST_POINTS), spacing


def _lasting_euler(
    balls: AlphaComplex, spacing: float, settings: WireSettings
) -> tuple[int, float, float, tuple[float, float]]:
    """The Euler characteristic of greatest weight, its share, its contrast, and the radii between which it stands."""
    radii, eulers, weight = balls.euler_weights(settings.smallest * spacing, settings.largest * spacing)
    values, index = np.unique(eulers, return_inverse=True)
    total = np.bincount(index, weight)
    best, second = np.argsort(-total)[:2] if len(total) > 1 else (0, 0)
    mine = np.where(eulers == values[best], weight, 0.0).cumsum() / total[best]
    smallest, largest = (
        float(radii[np.searchsorted(mine, level)]) / spacing for level in (settings.tail, 1 - settings.tail)
    )
    share = total / total.sum()
    contrast = share[best] / max(share[second], np.finfo(float).tiny)
    return int(values[best]), float(share[best]), float(contrast), (smallest, largest)


def _away_from_center_line(points: Floats, settings: WireSettings) -> Floats:
    """Unit directions (N, 3) from the mean of each neighborhood to its point, across its longest direction."""
    patch = points[cKDTree(points).query(points, min(settings.sizes[0] + 1, len(points)))[1]]
    center = patch.mean(1)
    patch = patch - center[:, None]
    axis = np.linalg.eigh(np.einsum("nka,nkb->nab", patch, patch))[1][:, :, 2]
    way = points - center
    return unit(way - (way * axis).sum(1, keepdims=True) * axis)
