"""Where the answer about a closed cloud may be wrong."""

from __future__ import annotations

from dataclasses import replace

from topokit.core.arrays import Floats
from topokit.core.cloud.evidence import Witness
from topokit.core.cloud.settings import QualitySettings
from topokit.core.cloud.votes import share_of
from topokit.core.scale.narrow_places import NarrowPlace, missed_places, surface_places
from topokit.core.surface import TriangleSurface

_MOST_VERTICES = 1 << 22  # of the grid on which narrow places are looked for: 5 to 10 s


def cloud_doubts(witness: Witness, surface: TriangleSurface, missed: Floats) -> tuple[NarrowPlace, ...]:
    """The places of a cloud's surface that are narrower than its resolution, and samples off the surface.

    Narrow places have the share of the votes that count as if they were otherwise: first come those with most of them,
    of equals the narrowest. The places where several samples are off the surface follow, unless noise does that.

    Args:
        witness: the evidence about the cloud.
        surface: the closed surface that was found.
        missed: (M, 3), samples off that surface.

    Raises:
        InputError: if narrow places need too fine a grid.
        MissingDependencyError: if cripser is not installed.
    """
    counted = [value for vote in witness.votes for value in vote.eulers]
    found = [
        replace(one, votes=share_of(witness.euler + (one.change or 0), counted))
        for one in surface_places(surface, witness.resolution, _MOST_VERTICES)
    ]
    found.sort(key=lambda one: (-(one.votes or 0.0), one.width, one.place))
    return (*found, *(() if is_noisy(witness) else missed_places(missed, witness.resolution / 2)))


def is_noisy(witness: Witness) -> bool:
    """Whether noise hides narrow features, so that more points alone would not show them."""
    return witness.preparation == "averaged" or witness.quality.roughness > QualitySettings().clean
