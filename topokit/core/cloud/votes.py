"""Votes on the Euler characteristic of oriented samples: several Delaunay cuts and winding-number fields, and a tally.

Two independent families look at the same samples: minimum cuts of Delaunay tetrahedra (several weights, original and
smoothed positions, counted from inside and from outside) and winding-number fields on grids (several resolutions and
smoothings). The Euler characteristic of the surface is twice that of the solid.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from topokit.core.cloud.delaunay_cut import (
    Cut,
    CutWeights,
    DelaunayComplex,
    cut_complex,
    delaunay_complex,
    solid_eulers,
)
from topokit.core.cloud.neighborhoods import LocalGeometry, crowded_shares, disagreement, flatten
from topokit.core.grid.euler import surface_euler
from topokit.core.grid.grid import make_grid
from topokit.core.grid.winding_field import winding_field

Floats = NDArray[np.float64]
Family = Literal["cut", "smooth cut", "field"]

CUT_SETTINGS = (CutWeights(0.5, 3.0, 4.0), CutWeights(1.5, 3.0, 6.0), CutWeights(0.3, 2.0, 2.0))
SMOOTH_SETTINGS = CUT_SETTINGS[:2]
FIELD_SETTINGS = ((1.5, 1.5, 128**3), (2.0, 1.5, 160**3), (2.0, 2.5, 160**3))
"""Cells per sample spacing, Gaussian smoothing in cells, largest number of grid vertices."""

WEIGHTS: dict[Family, tuple[float, ...]] = {
    "cut": (1.5, 1.0, 1.0),
    "smooth cut": (1.25, 1.0),
    "field": (0.8, 0.8, 0.6),
}
"""Weight of each setting's vote; a cut shares its weight between the counts from inside and from outside."""

CROWDED_REACH = (1.5, 2.5)
"""Distances, in sample spacings, at which an opposite sheet counts as close."""


@dataclass(frozen=True)
class Vote:
    """Euler characteristic of the surface under one setting.

    Attributes:
        family: "cut" (original positions), "smooth cut" (smoothed positions) or "field".
        setting: index into the family's settings.
        eulers: counted from inside and from outside for a cut, one value for a field.
    """

    family: Family
    setting: int
    eulers: tuple[int, ...]

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
    """

    coverage: float
    disagreement: float
    roughness: float
    crowded: float
    crowded_wide: float


def gather_votes(
    points: Floats, normals: Floats, local: LocalGeometry, areas: Floats, complex_: DelaunayComplex
) -> tuple[tuple[Vote, ...], SampleQuality, Cut]:
    """The vote of every setting on oriented samples.

    Args:
        points: (N, 3), centered, of moderate extent.
        normals: (N, 3), unit, outward.
        local: neighborhoods of the points.
        areas: (N,), surface area that each sample stands for.
        complex_: Delaunay tetrahedra of the points.

    Returns:
        The votes, the quality of the samples, and the first cut.
    """
    spacing = float(np.sqrt(areas.mean()))
    cuts = [cut_complex(complex_, normals, weights) for weights in CUT_SETTINGS]
    votes = [Vote("cut", k, _surface_eulers(complex_, cut)) for k, cut in enumerate(cuts)]
    smooth = delaunay_complex(flatten(points, normals, local), spacing)
    for k, weights in enumerate(SMOOTH_SETTINGS):
        votes.append(Vote("smooth cut", k, _surface_eulers(smooth, cut_complex(smooth, normals, weights))))
    p, n, a = (torch.as_tensor(values, dtype=torch.float32) for values in (points, normals, areas))
    for k, (per_spacing, sigma, most) in enumerate(FIELD_SETTINGS):
        field = winding_field(p, n, a, make_grid(p, spacing, per_spacing, most), sigma)
        votes.append(Vote("field", k, (int(surface_euler(field.values, 0.5, connectivity=6)),)))
    near, wide = crowded_shares(points, normals, local.wide_index, spacing, CROWDED_REACH)
    quality = SampleQuality(cuts[0].coverage, disagreement(normals, local.index), local.roughness, near, wide)
    return tuple(votes), quality, cuts[0]


def _surface_eulers(complex_: DelaunayComplex, cut: Cut) -> tuple[int, ...]:
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
