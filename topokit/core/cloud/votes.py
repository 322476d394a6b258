"""Votes on the Euler characteristic of an oriented cloud: several Delaunay cuts and winding-number fields.

Two independent families examine the same surface: minimum cuts of Delaunay tetrahedra of samples (several weights,
counted from inside and from outside) and winding-number fields on grids (several resolutions and smoothings), which
vote where their grids are as fine as the samples. Cuts of half as many samples test convergence: they do not decide the
integer, but what changes with the number of samples is doubtful. The Euler characteristic of the surface is twice that
of the solid.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.fields import Task, field_tasks
from topokit.core.cloud.normals.double_sheets import double_share
from topokit.core.cloud.normals.patches import (
    Neighborhoods,
    Patches,
    neighborhoods_of,
    opposite_neighbors,
)
from topokit.core.cloud.sampling.cube_hierarchy import curve_order
from topokit.core.cloud.sampling.downsampling import thin_along_curve
from topokit.core.cloud.sampling.samples_of_large_clouds import Sampler, Samples
from topokit.core.cloud.settings import CloudSettings
from topokit.core.cloud.solid.counts import solid_eulers
from topokit.core.cloud.solid.tetrahedra import Cut, DelaunayComplex, cut_complex, delaunay_complex
from topokit.core.neighbors import neighbor_components
from topokit.core.processors import n_cores

Family = Literal["cut", "coarse cut", "shifted cut", "field"]

CUT_FAMILIES: tuple[Family, ...] = ("cut", "shifted cut")
"""The families of Delaunay cuts of all samples."""

DECIDING: tuple[Family, ...] = ("cut", "field")
"""The families whose votes decide the integer."""

IN_COMPARISON = 2
"""So many of the cuts' weights are used on fewer and on shifted samples."""


@dataclass(frozen=True)
class Vote:
    """Euler characteristic of the surface under one setting.

    Attributes:
        family: "cut" (the samples), "coarse cut" (half as many samples), "shifted cut" (samples at positions that were
            not taken) or "field".
        setting: index into the family's settings.
        eulers: counted from inside and from outside for a cut, one value for a field.
        n_samples: number of samples that it is made from.
    """

    family: Family
    setting: int
    eulers: tuple[int, ...]
    n_samples: int = 0


@dataclass(frozen=True)
class SampleQuality:
    """How well the samples support an answer.

    Attributes:
        coverage: share of the samples on the surface of the first cut.
        roughness: median distance of neighbors from the local plane, in sample spacings.
        crowded_wide: share of the area with an opposite sheet within 2.5 spacings of all points.
        double: share of the neighborhoods that look like two sheets although their normals agree.
    """

    coverage: float
    roughness: float
    crowded_wide: float
    double: float


@dataclass(frozen=True, eq=False)
class OrientedCloud:
    """N points with outward normals, and the samples among them.

    Attributes:
        points: (N, 3), centered, of moderate extent.
        normals: (N, 3), unit, outward.
        areas: (N,), surface area that each point stands for.
        sampler: chooses samples.
        samples: the chosen ones.
        local: their neighborhoods.
        complex_: their tetrahedra.
    """

    points: Floats
    normals: Floats
    areas: Floats
    sampler: Sampler
    samples: Samples
    local: Neighborhoods
    complex_: DelaunayComplex

    @property
    def outward(self) -> Floats:
        """(M, 3), the normals of the samples."""
        return self.normals[self.samples.kept]


def gather_votes(
    cloud: OrientedCloud, settings: CloudSettings, made: Sequence[Cut] = ()
) -> tuple[tuple[Vote, ...], tuple[Cut, ...]]:
    """The vote of every setting, and the cuts of all samples.

    Args:
        cloud: with outward normals.
        settings: see there.
        made: the cuts of the samples with the first weights that were made already.
    """
    with ThreadPoolExecutor(n_cores()) as threads:
        coarse = threads.submit(_coarse_votes, cloud, settings)
        fields = [threads.submit(task) for task in _field_tasks(cloud, settings)]
        votes, cuts = cut_votes("cut", cloud.complex_, cloud.outward, settings, made=made)
        votes += coarse.result()
        n_points = min(len(cloud.points), settings.fields.most_points)
        votes += [Vote("field", k, (euler,), n_points) for field in fields for k, euler in field.result()]
    return tuple(votes), cuts


def cut_votes(
    family: Family,
    complex_: DelaunayComplex,
    normals: Floats,
    settings: CloudSettings,
    *,
    made: Sequence[Cut] = (),
    count: int | None = None,
) -> tuple[list[Vote], tuple[Cut, ...]]:
    """The votes of a complex under the first few weights, and the cuts.

    Args:
        family: of the votes.
        complex_: tetrahedra of M samples.
        normals: (M, 3), unit, outward.
        settings: with the weights.
        made: cuts with the first weights that were made already.
        count: number of weights, by default all.
    """
    weights = settings.cuts.weights[:count]
    cuts = (*made, *(cut_complex(complex_, normals, one) for one in weights[len(made) :]))
    eulers = [surface_eulers(complex_, cut) for cut in cuts]
    return [Vote(family, k, both, len(complex_.points)) for k, both in enumerate(eulers)], cuts


def _coarse_votes(cloud: OrientedCloud, settings: CloudSettings) -> list[Vote]:
    """Votes of both halves of the samples, or, of a large cloud, of half as many that are chosen alike."""
    kept, votes = cloud.samples.kept, []
    halves = _random_halves(kept) if cloud.samples.is_all else (cloud.sampler.chosen(len(kept) // 2)[0],)
    for half in halves:
        complex_ = complex_of(cloud.points[half], settings)[1]
        votes += cut_votes("coarse cut", complex_, cloud.normals[half], settings, count=IN_COMPARISON)[0]
    return votes


def _random_halves(samples: Integers) -> tuple[Integers, Integers]:
    """One of every two samples (M,) along the curve, at random, and the other ones."""
    coin = np.random.default_rng(len(samples)).integers(0, 2, -(-len(samples) // 2)).astype(bool)
    is_first = np.stack([coin, ~coin], 1).ravel()[: len(samples)]
    return samples[is_first], samples[~is_first]


def complex_of(points: Floats, settings: CloudSettings) -> tuple[Neighborhoods, DelaunayComplex]:
    """The neighborhoods and the tetrahedra of samples (M, 3)."""
    local = neighborhoods_of(points, settings.patches)
    return local, delaunay_complex(points, local.spacings)


def _field_tasks(cloud: OrientedCloud, settings: CloudSettings) -> Sequence[Task]:
    part = thin_along_curve(cloud.points, settings.fields.most_points)
    areas = cloud.areas[part] * (len(cloud.points) / len(part))

    def parts() -> Integers:
        index = torch.from_numpy(cloud.local.index[:, 1 : settings.patches.graph + 1])
        return neighbor_components(index).numpy()[cloud.samples.owner[part]]

    return field_tasks(cloud.points[part], cloud.normals[part], areas, cloud.local.finest, parts, settings.fields)


def sample_quality(cloud: OrientedCloud, patches: Patches, cut: Cut, settings: CloudSettings) -> SampleQuality:
    """How well the samples of a cloud support an answer.

    Args:
        cloud: with outward normals.
        patches: neighborhoods of its points.
        cut: the first cut.
        settings: of the distances at which sheets are close.
    """
    reach = settings.quality.feature
    return SampleQuality(
        coverage=cut.coverage,
        roughness=patches.thickness / cloud.local.spacing,
        crowded_wide=crowded_share(patches, cloud.normals, cloud.areas, cloud.samples.kept, reach, settings),
        double=double_share(patches, settings.sampling.probes, settings.doubles, cloud.normals),
    )


def crowded_share(
    patches: Patches, normals: Floats, areas: Floats, at: Integers, reach: float, settings: CloudSettings
) -> float:
    """Share of some points with an opposite sheet nearer than some local spacings, less than one spacing sideways.

    Where it is not nearly zero, walls or gaps are thinner than the points can resolve, and all settings may agree on a
    wrong integer.

    Args:
        patches: neighborhoods of N points.
        normals: (N, 3), unit, outward.
        areas: (N,), of the discs that hold neighbors on the same sheet.
        at: (M,), indices of the points at which sheets are looked for.
        reach: distance of the opposite sheet, in spacings.
        settings: of the cosine.
    """
    points = patches.points
    at = at[curve_order(points[at])[0]]  # queries near each other are faster
    n_neighbors = min(int(np.ceil(np.pi * reach**2)) * 2, len(points))
    index = patches.tree.query(points[at], n_neighbors)[1].reshape(len(at), -1)
    opposite, height, side = opposite_neighbors(
        points[at], normals[at], points[index], normals[index], settings.patches
    )
    spacing = np.sqrt(areas[patches.around[at]].mean(1, keepdims=True))
    return float((opposite & (side < spacing**2) & (np.abs(height) < reach * spacing)).any(1).mean())


def surface_eulers(complex_: DelaunayComplex, cut: Cut) -> tuple[int, ...]:
    """Euler characteristic of a cut's surface, counted from inside and from outside."""
    return tuple(2 * euler for euler in solid_eulers(complex_, cut.inside))


def tally(votes: Sequence[Vote]) -> tuple[int, float]:
    """The most frequent Euler characteristic among the deciding votes, the nearest to zero of equals, and its share."""
    values = values_of(votes, *DECIDING)
    euler = max(values, key=lambda value: (values.count(value), -abs(value)))
    return euler, values.count(euler) / len(values)


def values_of(votes: Sequence[Vote], *families: Family) -> list[int]:
    """All values of the votes of some families."""
    return [euler for vote in votes if vote.family in families for euler in vote.eulers]


def share_of(euler: int, values: Sequence[int]) -> float:
    """The share of the values that are this integer; 0 if there are none."""
    return values.count(euler) / len(values) if values else 0.0
