"""Votes on the Euler characteristic of oriented samples: several Delaunay cuts and winding-number fields, and a tally.

Two independent families look at the same samples: minimum cuts of Delaunay tetrahedra (several weights, original and
smoothed positions, counted from inside and from outside) and winding-number fields on grids (several resolutions and
smoothings). Of a large cloud, half as many samples are cut once more, which tests convergence, and fields vote only
where their grids are as fine as the samples. The Euler characteristic of the surface is twice that of the solid.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from topokit.core.cloud.cut_counts import solid_eulers
from topokit.core.cloud.delaunay_cut import Cut, CutWeights, DelaunayComplex, cut_complex, delaunay_complex
from topokit.core.cloud.dense import BOUNDARY_POINTS, DenseCloud, Samples
from topokit.core.cloud.downsampling import thin_along_curve
from topokit.core.cloud.neighborhoods import (
    LocalGeometry,
    crowded_shares,
    disagreement,
    flatten,
    local_spacings,
    typical_and_finest,
)
from topokit.core.grid.euler import surface_euler
from topokit.core.grid.grid import Grid, make_grid
from topokit.core.grid.winding_field import winding_field
from topokit.core.processors import n_cores

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Family = Literal["cut", "smooth cut", "coarse cut", "shifted cut", "field"]

CUT_SETTINGS = (CutWeights(), CutWeights(1.5, 3.0, 6.0), CutWeights(0.3, 2.0, 2.0))
SMOOTH_SETTINGS = CUT_SETTINGS[:2]
FIELD_SETTINGS = ((1.5, 1.5, 128**3), (2.0, 1.5, 160**3), (2.0, 2.5, 160**3))
"""Cells per sample spacing, Gaussian smoothing in cells, largest number of grid vertices."""

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

_PROBES = 2000  # samples at which sheets are looked for that are far apart in spacings
_MOST_IN_FIELD = 200_000  # points of a large cloud that its fields are made from

CROWDED_REACH = (1.5, 2.5)
"""Distances, in sample spacings, at which an opposite sheet counts as close."""


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
        disagreement: share of neighbor pairs whose normals oppose each other.
        roughness: median distance of neighbors from the local plane, in sample spacings.
        crowded: share of samples with an opposite sheet within 1.5 sample spacings.
        crowded_wide: the same within 2.5 sample spacings.
        crowded_boundary: the same within 1.5 spacings of the points on which boundaries are looked for.

    Of a large cloud these are measured on all points, as shares of the area.
    """

    coverage: float
    disagreement: float
    roughness: float
    crowded: float
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
    with ThreadPoolExecutor(n_cores()) as threads:
        cuts = [threads.submit(cut_complex, complex_, normals, weights) for weights in CUT_SETTINGS[len(made) :]]
        smooth = threads.submit(_cut_votes, "smooth cut", flatten(points, normals, local), normals, local.spacings)
        fields = [threads.submit(_field_vote, points, normals, areas, spacing, k) for k in range(len(FIELD_SETTINGS))]
        all_cuts = [*made, *(cut.result() for cut in cuts)]
        votes = _votes_of("cut", complex_, all_cuts)
        votes += [*smooth.result(), *(field.result() for field in fields)]
    near, wide = crowded_shares(points, normals, local.wide_index, spacing, CROWDED_REACH)
    first, opposed = all_cuts[0], disagreement(normals, local.index)
    return tuple(votes), SampleQuality(first.coverage, opposed, local.roughness, near, wide, near), first


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
    cuts, fields = [], []
    with ThreadPoolExecutor(n_cores()) as threads:
        coarse = threads.submit(_votes_of_cuts, "coarse cut", few.complex_, normals[few.kept])
        for k, weights in enumerate(CUT_SETTINGS):  # in turn: flows hold the interpreter's lock, fields do not
            if _field_grid(cloud.points[part], finest, k).cell <= finest:
                fields.append(threads.submit(_field_vote, cloud.points[part], normals[part], areas, finest, k))
            if k >= len(made):
                cuts.append(threads.submit(cut_complex, complex_, chosen, weights))
        quality = _dense_quality(cloud, normals, samples)
        all_cuts = [*made, *(cut.result() for cut in cuts)]
        votes = _votes_of("cut", complex_, all_cuts)
        votes += [*coarse.result(), *(field.result() for field in fields)]
    return tuple(votes), replace(quality, coverage=all_cuts[0].coverage), all_cuts[0]


def _dense_quality(cloud: DenseCloud, normals: Floats, samples: Samples) -> SampleQuality:
    """All but the coverage, which the first cut tells."""
    near, wide = cloud.crowded_shares(samples, normals, CROWDED_REACH)
    coarser = CROWDED_REACH[0] * max(len(cloud.points) / BOUNDARY_POINTS, 1.0) ** 0.5
    (boundary,) = cloud.crowded_shares(samples, normals, (coarser,), most_samples=_PROBES)
    opposed = cloud.disagreement(normals)
    return SampleQuality(0.0, opposed, cloud.surface.roughness, near, wide, boundary)


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


def _field_vote(points: Floats, normals: Floats, areas: Floats, spacing: float, setting: int) -> Vote:
    p, n, a = (torch.as_tensor(values, dtype=torch.float32) for values in (points, normals, areas))
    field = winding_field(p, n, a, _field_grid(points, spacing, setting), FIELD_SETTINGS[setting][1])
    return Vote("field", setting, (int(surface_euler(field.values, 0.5, connectivity=6)),), len(points))


def _field_grid(points: Floats, spacing: float, setting: int) -> Grid:
    per_spacing, _, most = FIELD_SETTINGS[setting]
    return make_grid(torch.as_tensor(points, dtype=torch.float32), spacing, per_spacing, most)


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
