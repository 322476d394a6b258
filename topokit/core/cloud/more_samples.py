"""More samples of a large cloud, where the votes of fewer differ: what changes with their number is not the surface's.

They are believed if all their cuts give one integer and if signs from empty spheres would not change it: where walls
are too thin for any number of samples, cuts may agree on what the next signs refute.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from topokit.core.cloud.delaunay_cut import Cut, DelaunayComplex, cut_complex, delaunay_complex
from topokit.core.cloud.dense import MORE_SAMPLES, DenseCloud
from topokit.core.cloud.neighborhoods import local_spacings
from topokit.core.cloud.poles import normals_by_poles
from topokit.core.cloud.votes import WEIGHTS, Vote, cut_votes, surface_eulers

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class MoreSamples:
    """Samples whose cuts all agree.

    Attributes:
        kept: (M,), their indices in the cloud.
        spacings: (M,), typical distances between samples around each.
        complex_: their tetrahedra.
        cut: of these with the weights by default.
        votes: one for each setting.
    """

    kept: Integers
    spacings: Floats
    complex_: DelaunayComplex
    cut: Cut
    votes: tuple[Vote, ...]

    def with_votes_of_fewer(self, votes: Sequence[Vote]) -> tuple[Vote, ...]:
        """Their votes, with those of half as many samples for comparison and of fields, which all points make."""
        coarse = WEIGHTS["coarse cut"]
        compared = [replace(vote, family="coarse cut") for vote in votes if vote.family == "cut"]
        fields = [vote for vote in votes if vote.family == "field"]
        return (*self.votes, *compared[: len(coarse)], *fields)


def more_samples(cloud: DenseCloud, normals: Floats, *, are_found: bool) -> MoreSamples | None:
    """Twice as many samples as are looked at first; None if there are not as many points, or if their cuts differ.

    Args:
        cloud: all points.
        normals: (N, 3), unit, outward, of all points.
        are_found: whether the signs were found rather than given; then those of empty spheres must give the same.
    """
    if len(cloud.points) < MORE_SAMPLES:
        return None
    kept = cloud.samples(MORE_SAMPLES).kept
    points, outward = cloud.points[kept], normals[kept]
    spacings = local_spacings(points)
    complex_ = delaunay_complex(points, spacings)
    first = cut_complex(complex_, outward)
    if are_found:
        _, corrected = normals_by_poles(complex_, outward, first, rounds=1)
        if surface_eulers(complex_, corrected) != surface_eulers(complex_, first):
            return None
    votes, _ = cut_votes(complex_, outward, (first,))
    is_one = len({euler for vote in votes for euler in vote.eulers}) == 1
    return MoreSamples(kept, spacings, complex_, first, tuple(votes)) if is_one else None
