"""Where the answer about a closed cloud may be wrong."""

from __future__ import annotations

from dataclasses import replace

from topokit.core.arrays import Floats
from topokit.core.cloud.evidence import Witness
from topokit.core.cloud.settings import QualitySettings
from topokit.core.cloud.votes import share_of
from topokit.core.scale.narrow_places import NarrowPlace, missed_places, surface_places
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError

_MOST_VERTICES = 1 << 22  # of the grid on which narrow places are looked for: 5 to 10 s


def cloud_doubts(witness: Witness | None, points: Floats) -> tuple[NarrowPlace, ...]:
    """The places of a cloud's surface that are narrower than its resolution, and samples off the surface.

    Narrow places have the share of the votes that count as if they were otherwise: first come those with most of them,
    of equals the narrowest. The places where several samples are off the surface follow, unless noise does that.

    Args:
        witness: what was found of a closed surface, or None.
        points: (N, 3), the cloud.

    Raises:
        InputError: if no closed surface was found, or its narrow places need too fine a grid.
        MissingDependencyError: if cripser is not installed.
    """
    if witness is None or witness.surface is None or len(witness.surface.faces) == 0:
        raise InputError("no closed surface was found.")
    surface = TriangleSurface(points[witness.surface.points], witness.surface.faces)
    counted = [value for vote in witness.votes for value in vote.eulers]
    found = [
        replace(one, votes=share_of(witness.euler + (one.change or 0), counted))
        for one in surface_places(surface, witness.resolution, _MOST_VERTICES)
    ]
    found.sort(key=lambda one: (-(one.votes or 0.0), one.width, one.place))
    missed = () if is_noisy(witness) else missed_places(points[witness.missed], witness.resolution / 2)
    return (*found, *missed)


def is_noisy(witness: Witness) -> bool:
    """Whether noise hides narrow features, so that more points alone would not show them."""
    return witness.preparation == "averaged" or witness.quality.roughness > QualitySettings().clean
