"""What the global witness of a cloud returns: numbers, without a verdict."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from topokit.core.arrays import Floats, Integers
from topokit.core.cloud.given_normals import Signs
from topokit.core.cloud.solid.surface import CutSurface
from topokit.core.cloud.solid.uncovered import UncoveredPatch
from topokit.core.cloud.solid.wires import WireReading
from topokit.core.cloud.votes import SampleQuality, Vote

Preparation = Literal["whole", "sampled", "averaged", "wire"]


@dataclass(frozen=True, eq=False)
class Witness:
    """The global evidence about the closed surface of a cloud.

    Attributes:
        euler: Euler characteristic of the surface.
        agreement: share of the deciding votes for that integer.
        votes: Euler characteristic per setting.
        quality: how well the samples support the answer.
        signs: where the outward directions came from.
        components: parts of the solid.
        cavities: holes wholly inside the solid; the surface has components + cavities components.
        normals: (N, 3), unit, outward, for every point given.
        n_points: points given.
        n_used: points in the first cut, after downsampling and without points that coincide with others.
        spacing: typical distance between the used points, in units of length; of a large cloud the median.
        resolution: size of the smallest feature that the votes can see, in units of length.
        seconds: time per stage.
        surface: that of the first cut, or, of a closed cloud, of the first one with that integer, as triangles of the
            points given; components and cavities are its own. None where it is not what was taken over.
        preparation: "whole" (all points in every cut), "sampled" (normals from all points, cuts of samples where
            features are small), "averaged" (noise hides the surface from neighbors: even samples, each moved onto the
            plane of its wider neighborhood) or "wire" (one-dimensional everywhere: even samples, no cuts).
        wire: the reading as a thickened graph, if its integer was taken over because the cloud is one-dimensional
            everywhere, else None.
        is_shifted: whether the votes are those of samples shifted along their normals, which widens thin walls and
            narrow gaps.
        is_smoothed: whether the votes of noisy samples differed, so that those of smoothed samples with normals of
            their own were added.
        rounding: step between neighboring values of the coordinates, in units of length, where these have no more
            digits than single precision; else 0.
        lids: patches of the first cut's surface that cover holes of the cloud, largest first; their samples are those
            of the points given. None for a wire.
        missed: (M,), indices of the used points that are not on that surface.
    """

    euler: int
    agreement: float
    votes: tuple[Vote, ...]
    quality: SampleQuality
    signs: Signs
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
    is_shifted: bool = False
    is_smoothed: bool = False
    rounding: float = 0.0
    lids: tuple[UncoveredPatch, ...] = ()
    missed: Integers = field(default_factory=lambda: np.empty(0, np.int64))

    @property
    def has_genus(self) -> bool:
        """Whether the integer fits the number of surfaces, of which there must be one: a genus cannot be negative."""
        n_surfaces = self.components + self.cavities
        return n_surfaces > 0 and self.euler <= 2 * n_surfaces
