"""What the global witness of a cloud returns: numbers, without a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from topokit.core.cloud.cut_surface import CutSurface
from topokit.core.cloud.uncovered import UncoveredPatch
from topokit.core.cloud.votes import SampleQuality, Vote
from topokit.core.cloud.wires import WireReading

Floats = NDArray[np.float64]
SignSource = Literal["given", "reversed", "contradictory", "axes", "none"]
Preparation = Literal["whole", "sampled", "averaged", "thinned", "wire"]


@dataclass(frozen=True)
class Signs:
    """Where the outward directions came from.

    Attributes:
        source: "given" (as they came), "reversed" (they all pointed inward), "contradictory" (they disagreed, so signs
            were found), "axes" (given without signs), "none" (no normals were given).
        confirmed: share of the given normals that the points confirm, or None where signs were not given.
        coverage: share of the samples on the surface that the found directions imply, or None where none were found.
    """

    source: SignSource
    confirmed: float | None
    coverage: float | None

    def apply(self, given: Floats | None) -> Floats | None:
        """Given normals turned outward as a whole; None if their signs had to be found one by one."""
        if given is None or self.source not in ("given", "reversed"):
            return None
        return given if self.source == "given" else -given


@dataclass(frozen=True)
class SmoothedLook:
    """A second look at a noisy cloud whose votes contradict each other, smoothed over wide neighborhoods.

    Attributes:
        euler: Euler characteristic of the surface that the smoothed points give.
        agreement: its share of the weight of all votes.
        n_neighbors: neighbors that each point was smoothed over.
    """

    euler: int
    agreement: float
    n_neighbors: int


@dataclass(frozen=True, eq=False)
class Witness:
    """The global evidence about the closed surface of a cloud.

    Attributes:
        euler: Euler characteristic of the surface.
        agreement: share of the weight of all votes that stands behind the heaviest integer.
        votes: Euler characteristic per setting.
        quality: how well the samples support the answer.
        signs: where the outward directions came from.
        smoothed: the second look, if its integer was taken over, else None.
        components: parts of the solid.
        cavities: holes wholly inside the solid; the surface has components + cavities components.
        normals: (N, 3), unit, outward, for every point given.
        n_points: points given.
        n_used: points in the first cut, after downsampling and without points that coincide with others.
        spacing: typical distance between the used points, in units of length; of a large cloud the median.
        resolution: size of the smallest feature that the votes can see, in units of length.
        seconds: time per stage.
        surface: that of the first cut, as triangles of the points given; None where it is not what was taken over.
        preparation: "whole" (all points in every cut), "sampled" (normals from all points, cuts of samples where
            features are small), "averaged" (too noisy for that: even samples, each averaged over its neighbors),
            "thinned" (so noisy that only few samples are left, averaged over wide neighborhoods) or "wire"
            (one-dimensional everywhere: even samples).
        wire: the reading as a thickened graph, if its integer was taken over because the cloud is one-dimensional
            everywhere, else None.
        is_widened: whether the votes are those of samples shifted along their normals, which widens thin walls and
            narrow gaps.
        is_repeated: whether the votes of noisy samples differed, so that those of smoothed samples with normals of
            their own were added.
        rounding: step between neighboring values of the coordinates, in units of length, where these have no more
            digits than single precision; else 0.
        uncovered: patches of the first cut's surface far from all samples, largest first; their samples are those of
            the points given. None for a wire.
    """

    euler: int
    agreement: float
    votes: tuple[Vote, ...]
    quality: SampleQuality
    signs: Signs
    smoothed: SmoothedLook | None
    components: int
    cavities: int
    normals: Floats
    n_points: int
    n_used: int
    spacing: float
    resolution: float
    seconds: dict[str, float]
    surface: CutSurface | None
    preparation: Preparation = "whole"
    wire: WireReading | None = None
    is_widened: bool = False
    is_repeated: bool = False
    rounding: float = 0.0
    uncovered: tuple[UncoveredPatch, ...] = ()

    @property
    def is_downsampled(self) -> bool:
        """Whether the cloud was too large for all of its points to be in one cut."""
        return self.preparation != "whole"
