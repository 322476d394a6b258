"""Votes on the Euler characteristic of oriented samples: several Delaunay cuts and winding-number fields, and a tally.

Two independent families look at the same samples: minimum cuts of Delaunay tetrahedra (several weights, original and
smoothed positions, counted from inside and from outside) and winding-number fields on grids (several resolutions and
smoothings), which vote where their grids are as fine as the samples. Of a large cloud half as many samples are cut
once more, which tests convergence. The Euler characteristic of the surface is twice that of the solid.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from topokit.core.cloud.cut_counts import solid_eulers
from topokit.core.cloud.delaunay_cut import Cut, CutWeights, DelaunayComplex, cut_complex, delaunay_complex
from topokit.core.cloud.dense import BOUNDARY_POINTS, DenseCloud, Samples
from topokit.core.cloud.downsampling import thin_along_curve
from topokit.core.cloud.fields import field_tasks
from topokit.core.cloud.neighborhoods import (
    LocalGeometry,
    crowded_shares,
    flatten,
    local_spacings,
    typical_and_finest,
)
from topokit.core.neighbors import neighbor_components
from topokit.core.processors import n_cores

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Family = Literal["cut", "smooth cut", "coarse cut", "shifted cut", "field"]

CUT_SETTINGS = (CutWeights(), CutWeights(1.5, 3.0, 6.0), CutWeights(0.3, 2.0, 2.0))
SMOOTH_SETTINGS = CUT_SETTINGS[:2]
CUT_FAMILIES: tuple[Family, ...] = ("cut", "smooth cut", "coarse cut", "shifted cut")
"""The families of Delaunay cuts."""

WEIGHTS: dict[Family, tuple[float, ...]] = {
    "cut": (1.5, 1.0, 1.0),
    "smooth cut": (1.25, 1.0),
    "coarse cut": (1.25, 1.0),
    "shifted cut": (0.6, 0.4),
    "field": (0.8, 0.8, 0.6),
}
"""Weight of each setting's vote; a cut shares its weight between the counts from inside and from outside."""

_GRAPH = 9  # columns of the nearest neighbors that join samples to parts: the sample itself and eight
_PROBES = 2000  # samples at which sheets are looked for that are far apart in spacings
_MOST_IN_FIELD = 200_000  # points of a large cloud that its fields are made from

_NEAR, _WIDE = 1.5, 2.5  # distances, in sample spacings, at which an opposite sheet counts as close


@dataclass(frozen=True)
class Vote:
    """Euler characteristic of the surface under one setting.

    Attributes:
        family: "cut" (original positions), "smooth cut" (smoothed positions), "coarse cut" (half as many samples of a
            large cloud), "shifted cut" (at positions that were not taken) or "field".
        setting: index into the family's settings.
        eulers: counted from inside and from outside for a cut, one value for a field.
        n_samples: number of samples that it is made from.
    """

    family: Family
    setting: int
    eulers: tuple[int, ...]
    n_samples: int = 0

    @property
    def weight(self) -> float:
        """Weight of the vote, shared evenly by its values."""
        return WEIGHTS[self.family][self.setting]


@dataclass(frozen=True)
class SampleQuality:
    """How well the samples support an answer.

    Attributes:
        coverage: share of the samples on the surface of the first cut.
        roughness: median distance of neighbors from the local plane, in sample spacings.
        crowded_wide: share of samples with an opposite sheet within 2.5 sample spacings.
        crowded_boundary: the same within 1.5 spacings of the points on which boundaries are looked for.

    Of a large cloud all but the coverage are measured on all points, the shares as shares of the area.
    """

    coverage: float
    roughness: float
    crowded_wide: float
    crowded_boundary: float


@dataclass(frozen=True, eq=False)
class CoarseSamples:
    """Fewer samples of a large cloud than are looked at, which should show the same.

    Attributes:
        kept: (M,), their indices in the cloud.
        complex_: their tetrahedra.
    """

    kept: Integers
    complex_: DelaunayComplex


def coarse_samples(cloud: DenseCloud, budget: int) -> CoarseSamples:
    """At most so many samples where features are small."""
    kept = cloud.samples(budget).kept
    points = cloud.points[kept]
    return CoarseSamples(kept, delaunay_complex(points, local_spacings(points)))


def gather_votes(
    points: Floats,
    normals: Floats,
    local: LocalGeometry,
    areas: Floats,
    complex_: DelaunayComplex,
    made: Sequence[Cut] = (),
) -> tuple[tuple[Vote, ...], SampleQuality, Cut]:
    """The vote of every setting on all samples of a cloud of moderate size.

    Args:
        points: (N, 3), centered, of moderate extent.
        normals: (N, 3), unit, outward.
        local: neighborhoods of the points.
        areas: (N,), surface area that each sample stands for.
        complex_: Delaunay tetrahedra of the points.
        made: the cuts of the first settings that were made already.

    Returns:
        The votes, the quality of the samples, and the first cut.
    """
    spacing = float(np.sqrt(areas.mean()))

    def parts() -> Integers:
        return neighbor_components(torch.from_numpy(local.index[:, 1:_GRAPH])).numpy()

    with ThreadPoolExecutor(n_cores()) as threads:
        cuts = [threads.submit(cut_complex, complex_, normals, weights) for weights in CUT_SETTINGS[len(made) :]]
        smooth = threads.submit(_cut_votes, "smooth cut", flatten(points, normals, local), normals, local.spacings)
        fields = [threads.submit(task) for task in field_tasks(points, normals, areas, spacing, parts)]
        all_cuts = [*made, *(cut.result() for cut in cuts)]
        votes = _votes_of("cut", complex_, all_cuts)
        votes += [*smooth.result(), *_field_votes(fields, len(points))]
    near, wide = crowded_shares(points, normals, local.wide_index, spacing, (_NEAR, _WIDE))
    return tuple(votes), SampleQuality(all_cuts[0].coverage, local.roughness, wide, near), all_cuts[0]


def gather_dense_votes(
    cloud: DenseCloud,
    normals: Floats,
    samples: Samples,
    local: LocalGeometry,
    complex_: DelaunayComplex,
    few: CoarseSamples,
    made: Sequence[Cut] = (),
) -> tuple[tuple[Vote, ...], SampleQuality, Cut]:
    """The vote of every setting on a large cloud: on its samples, on half as many, and on grids that are fine enough.

    Args:
        cloud: all points.
        normals: (N, 3), unit, outward, of all points.
        samples: those that the tetrahedra are made of.
        local: neighborhoods of the samples.
        complex_: Delaunay tetrahedra of the samples.
        few: fewer samples, for comparison.
        made: the cuts of the first settings that were made already.

    Returns:
        As for `gather_votes`.
    """
    chosen = normals[samples.kept]
    part, finest = thin_along_curve(cloud.points, _MOST_IN_FIELD), typical_and_finest(local.spacings)[1]
    areas = cloud.surface.areas[part] * (len(cloud.points) / len(part))
    cuts = []
    with ThreadPoolExecutor(n_cores()) as threads:
        coarse = threads.submit(_votes_of_cuts, "coarse cut", few.complex_, normals[few.kept])
        tasks = field_tasks(cloud.points[part], normals[part], areas, finest, lambda: cloud.propagation.parts[part])
        fields = []
        for k in range(max(len(tasks), len(CUT_SETTINGS))):  # in turn: flows hold the interpreter's lock, fields do not
            fields += [threads.submit(task) for task in tasks[k : k + 1]]
            if k >= len(made):
                cuts += [threads.submit(cut_complex, complex_, chosen, weights) for weights in CUT_SETTINGS[k : k + 1]]
        quality = _dense_quality(cloud, normals, samples, local.spacing)
        all_cuts = [*made, *(cut.result() for cut in cuts)]
        votes = _votes_of("cut", complex_, all_cuts)
        votes += [*coarse.result(), *_field_votes(fields, len(part))]
    return tuple(votes), replace(quality, coverage=all_cuts[0].coverage), all_cuts[0]


def _dense_quality(cloud: DenseCloud, normals: Floats, samples: Samples, spacing: float) -> SampleQuality:
    """All but the coverage, which the first cut tells; the spacing is that of the samples."""
    (wide,) = cloud.crowded_shares(samples, normals, (_WIDE,))
    coarser = _NEAR * max(len(cloud.points) / BOUNDARY_POINTS, 1.0) ** 0.5
    (boundary,) = cloud.crowded_shares(samples, normals, (coarser,), most_samples=_PROBES)
    return SampleQuality(0.0, cloud.surface.thickness / spacing, wide, boundary)


def cut_votes(complex_: DelaunayComplex, normals: Floats, made: Sequence[Cut]) -> tuple[list[Vote], Cut]:
    """The votes of all cuts of samples where they are, of which the first were made already, and the first cut."""
    cuts = [*made, *(cut_complex(complex_, normals, weights) for weights in CUT_SETTINGS[len(made) :])]
    return _votes_of("cut", complex_, cuts), cuts[0]


def _cut_votes(family: Family, points: Floats, normals: Floats, spacings: Floats) -> list[Vote]:
    return _votes_of_cuts(family, delaunay_complex(points, spacings), normals)


def _votes_of_cuts(family: Family, complex_: DelaunayComplex, normals: Floats) -> list[Vote]:
    cuts = [cut_complex(complex_, normals, weights) for weights in SMOOTH_SETTINGS]
    return _votes_of(family, complex_, cuts)


def _votes_of(family: Family, complex_: DelaunayComplex, cuts: Sequence[Cut]) -> list[Vote]:
    """One vote for each cut, in the order of the family's settings."""
    return [Vote(family, k, surface_eulers(complex_, cut), len(complex_.points)) for k, cut in enumerate(cuts)]


def _field_votes(fields: Sequence[Future[list[tuple[int, int]]]], n_points: int) -> list[Vote]:
    return [Vote("field", setting, (euler,), n_points) for field in fields for setting, euler in field.result()]


def surface_eulers(complex_: DelaunayComplex, cut: Cut) -> tuple[int, ...]:
    """Euler characteristic of a cut's surface, counted from inside and from outside."""
    return tuple(2 * euler for euler in solid_eulers(complex_, cut.inside))


def tally(votes: Iterable[Vote]) -> tuple[int, float]:
    """The Euler characteristic of greatest weight (of equal ones the nearest to zero) and its share of all weight."""
    weight: dict[int, float] = {}
    total = 0.0
    for vote in votes:
        for euler in vote.eulers:
            share = vote.weight / len(vote.eulers)
            weight[euler] = weight.get(euler, 0.0) + share
            total += share
    euler = max(weight, key=lambda value: (weight[value], -abs(value)))
    return euler, weight[euler] / total


def values_of(votes: Sequence[Vote], *families: Family) -> list[int]:
    """All values of the votes of some families."""
    return [euler for vote in votes if vote.family in families for euler in vote.eulers]


def share_of(euler: int, values: Sequence[int]) -> float:
    """The share of the values that are this integer; 0 if there are none."""
    return values.count(euler) / len(values) if values else 0.0
