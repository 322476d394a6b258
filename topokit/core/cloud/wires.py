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
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from topokit.core.cloud.neighborhoods import unit, with_neighbors
from topokit.core.cloud.union_of_balls import AlphaComplex, alpha_complex
from topokit.core.labels import connected_labels, count_distinct
from topokit.core.neighbors import nearest_neighbors

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_SIZES = (25, 50, 100)  # points of the neighborhoods that are tested: four to eight spacings across where it is flat
_PARTS = 20  # neighborhoods that the cloud must hold at least
_PROBES = 1000  # neighborhoods looked at
_NARROW = 0.3  # median second variance over the first; 47 real shapes: at least 0.56; wires: mostly below 0.2
_DISPLACEMENT = 1e-4  # in spacings; points of a lattice have no unique tetrahedra
_SMALLEST, _LARGEST = 1.0, 6.0  # radii that are compared, in spacings: gaps are closed, and wires not yet joined
_TAIL = 0.05  # share of the integer's weight left out at both ends of the range that is reported
_STEPS = 8  # neighbors that connect a part, and whose disc is the area of that many points
_STRAY_GAP = 6.0  # distance in spacings that joins everything but stray points
_STRAY = 0.01  # share of all points up to which a separate part is clutter
_AROUND = 30  # neighbors that hold a whole cross-section


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


def read_wire(points: Floats) -> WireReading | None:
    """The reading of a cloud as wires, or None if its neighborhoods are not one-dimensional or its balls hold cavities.

    Args:
        points: (N, 3), distinct, not in a plane.
    """
    started = time.perf_counter()
    narrowness = segment_narrowness(points, cKDTree(points))
    if min(narrowness, default=1.0) > _NARROW:
        return None
    kept, spacing = _without_stray_points(points)
    displacement = np.random.default_rng(0).normal(size=(len(kept), 3))
    balls = alpha_complex(points[kept] + _DISPLACEMENT * spacing * displacement)
    euler, share, contrast, (smallest, largest) = _lasting_euler(balls, spacing)
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
        normals=_away_from_center_line(points),
        seconds=time.perf_counter() - started,
    )


def looks_narrow(points: Floats, tree: cKDTree) -> bool:
    """Whether some neighborhoods of points (N, 3) are one-dimensional, so that the cloud may be a wire."""
    return min(segment_narrowness(points, tree), default=1.0) <= _NARROW


def segment_narrowness(points: Floats, tree: cKDTree) -> tuple[float, ...]:
    """Median ratio of the second to the first variance of neighborhoods of 25, 50 and 100 points.

    Sizes of which the cloud (N, 3) does not hold twenty are left out, so the tuple is empty for N < 500.

    Args:
        points: (N, 3).
        tree: of the points.
    """
    sizes = [size for size in _SIZES if size * _PARTS <= len(points)]
    if not sizes:
        return ()
    probes = points[:: max(1, len(points) // _PROBES)]
    nearest = tree.query(probes, sizes[-1] + 1)[1]
    return tuple(_median_narrowness(points[nearest[:, : size + 1]]) for size in sizes)


def _median_narrowness(patch: Floats) -> float:
    patch = patch - patch.mean(1, keepdims=True)
    variance = np.linalg.eigvalsh(np.einsum("nka,nkb->nab", patch, patch))
    return float(np.median(variance[:, 1] / np.maximum(variance[:, 2], np.finfo(float).tiny)))


def _without_stray_points(points: Floats) -> tuple[Integers, float]:
    """Indices of the points whose part of the neighbor graph is more than clutter, and the sample spacing.

    The spacing is √(median area per point), from the eighth neighbor; unlike the mean, it ignores stray points.
    """
    nearest = nearest_neighbors(torch.from_numpy(points), _STEPS).numpy()
    distance = np.linalg.norm(points[nearest] - points[:, None], axis=2)
    spacing = float(np.median(distance[:, -1]) * np.sqrt(np.pi / _STEPS))
    point, rank = np.nonzero(distance < _STRAY_GAP * spacing)
    part = connected_labels(len(points), point, nearest[point, rank])
    return np.flatnonzero(np.bincount(part)[part] > _STRAY * len(points)), spacing


def _lasting_euler(balls: AlphaComplex, spacing: float) -> tuple[int, float, float, tuple[float, float]]:
    """The Euler characteristic of greatest weight, its share, its contrast, and the radii between which it stands."""
    radii, eulers = balls.euler_curve()
    radii = radii / spacing
    start = np.clip(radii, _SMALLEST, _LARGEST)
    weight = 1 / start - 1 / np.append(start[1:], _LARGEST)
    values, index = np.unique(eulers, return_inverse=True)
    total = np.bincount(index, weight)
    best, second = np.argsort(-total)[:2] if len(total) > 1 else (0, 0)
    mine = np.where(eulers == values[best], weight, 0.0).cumsum() / total[best]
    smallest, largest = (float(start[np.searchsorted(mine, level)]) for level in (_TAIL, 1 - _TAIL))
    share = total / total.sum()
    contrast = share[best] / max(share[second], np.finfo(float).tiny)
    return int(values[best]), float(share[best]), float(contrast), (smallest, largest)


def _away_from_center_line(points: Floats) -> Floats:
    """Unit directions (N, 3) from the mean of each neighborhood to its point, across its longest direction."""
    patch = points[with_neighbors(points, min(_AROUND, len(points) - 1))]
    center = patch.mean(1)
    patch = patch - center[:, None]
    axis = np.linalg.eigh(np.einsum("nka,nkb->nab", patch, patch))[1][:, :, 2]
    way = points - center
    return unit(way - (way * axis).sum(1, keepdims=True) * axis)
