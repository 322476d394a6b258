"""A cloud that is ready to be looked at, and what one look at it finds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from topokit.core.cloud.delaunay_cut import Cut, DelaunayComplex
from topokit.core.cloud.findings import Preparation, Signs, SignSource
from topokit.core.cloud.votes import SampleQuality, Vote
from topokit.core.cloud.wires import WireReading

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Cloud:
    """Distinct points ready to be looked at: centered and scaled.

    Attributes:
        points: (N, 3), in units of a power of two near the length of the cloud.
        normals: (N, 3), unit, or None.
        areas: (N,), area per point, or None.
        oriented: whether the signs of the normals mean anything.
    """

    points: Floats
    normals: Floats | None
    areas: Floats | None
    oriented: bool

    @property
    def unsigned_source(self) -> SignSource:
        """Where outward directions come from if no given signs are used."""
        return "none" if self.normals is None else "axes"

    def reduced(self, kept: Integers, moved: Floats) -> Cloud:
        """Some of its points at other positions, without areas."""
        return Cloud(moved, None if self.normals is None else self.normals[kept], None, self.oriented)


@dataclass(frozen=True, eq=False)
class Look:
    """What one look at a cloud found.

    Attributes:
        signs: where the outward directions came from.
        normals: (N, 3), unit, outward, of all points of the cloud.
        votes: with the quality of the samples and the first cut.
        quality: see there.
        cut: see there.
        complex_: tetrahedra of the samples.
        kept: (M,), indices of the samples in the cloud.
        points: (M, 3), where the samples are taken to be.
        spacing: typical distance between samples.
        finest: that of the finest samples.
        turned: when the normals were found.
        wire: the reading as a thickened graph, or None.
        preparation: see `Witness`.
        is_widened: see `Witness`.
        is_repeated: see `Witness`.
    """

    signs: Signs
    normals: Floats
    votes: tuple[Vote, ...]
    quality: SampleQuality
    cut: Cut
    complex_: DelaunayComplex
    kept: Integers
    points: Floats
    spacing: float
    finest: float
    turned: float
    wire: WireReading | None = None
    preparation: Preparation = "whole"
    is_widened: bool = False
    is_repeated: bool = False
