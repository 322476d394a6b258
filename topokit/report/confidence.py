"""The probability that the integer of a point cloud is right: a logistic model of the evidence."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from topokit.core.cloud.votes import values_of
from topokit.core.cloud.witness import Witness
from topokit.core.local.boundary import BoundaryEstimate


@dataclass(frozen=True)
class Doubt:
    """One kind of evidence against an answer.

    Attributes:
        meaning: what is measured.
        coefficient: log-odds lost per unit of doubt.
        doubt: the doubt that a measured value gives, 0 where there is none.
    """

    meaning: str
    coefficient: float
    doubt: Callable[[float], float]


def _missing(share: float) -> float:
    return 1 - share


def _itself(value: float) -> float:
    return value


def _saturating(value: float) -> float:
    return math.log1p(100 * value)  # from one in a hundred on, twice as many are not twice as bad


EVIDENCE: Mapping[str, Doubt] = MappingProxyType(
    {
        "cuts": Doubt("share of the Delaunay cuts of the points that give the integer", 0.0, _missing),
        "smooth_cuts": Doubt("the same, of smoothed points", 0.0, _missing),
        "fields": Doubt("share of the winding-number fields that give the integer", 0.0, _missing),
        "spread": Doubt("range of all integers", 0.0, math.log1p),
        "handles": Doubt("handles and surfaces that the answer counts", 0.0, math.log1p),
        "crowded": Doubt("share of samples with an opposite sheet within 1.5 spacings", 0.0, _saturating),
        "crowded_wide": Doubt("the same within 2.5 spacings", 0.0, _saturating),
        "coverage": Doubt("share of the samples on the surface that was found", 0.0, _missing),
        "disagreement": Doubt("share of neighbors whose normals oppose each other", 0.0, _saturating),
        "roughness": Doubt("median distance of neighbors from the local plane, in spacings", 0.0, _itself),
        "rim": Doubt("share of samples with neighbors on one side only", 0.0, _saturating),
        "unconfirmed": Doubt("share of given normals that the points do not confirm", 0.0, _itself),
    }
)


def cloud_evidence(witness: Witness, boundary: BoundaryEstimate) -> dict[str, float]:
    """The measured values of all evidence about a closed cloud."""
    euler, quality = witness.euler, witness.quality
    values = values_of(witness.votes, "cut", "smooth cut", "field")
    n_surfaces = witness.components + witness.cavities

    def share(family: str) -> float:
        own = values_of(witness.votes, family)
        return own.count(euler) / len(own)

    confirmed = witness.signs.confirmed
    return {
        "cuts": share("cut"),
        "smooth_cuts": share("smooth cut"),
        "fields": share("field"),
        "spread": float(max(values) - min(values)),
        "handles": max(n_surfaces - euler / 2, 0.0) + n_surfaces - 1,
        "crowded": quality.crowded,
        "crowded_wide": quality.crowded_wide,
        "coverage": quality.coverage,
        "disagreement": quality.disagreement,
        "roughness": quality.roughness,
        "rim": boundary.rim_share,
        "unconfirmed": 0.0 if confirmed is None else 1 - confirmed,
    }
