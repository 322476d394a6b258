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


def _itself(value: float) -> float:
    return value


def _saturating(value: float) -> float:
    return math.log1p(100 * value)  # from one in a hundred on, twice as many are not twice as bad


INTERCEPT = 0.0  # log-odds of an answer without any doubt

EVIDENCE: Mapping[str, Doubt] = MappingProxyType(
    {
        "cuts": Doubt("share of the Delaunay cuts that give another integer", 0.0, _itself),
        "others": Doubt("the same, of smoothed points or half as many samples", 0.0, _itself),
        "fields": Doubt("share of the winding-number fields that give another integer", 0.0, _itself),
        "no_fields": Doubt("1 if no grid is as fine as the samples", 0.0, _itself),
        "spread": Doubt("range of all integers", 0.0, math.log1p),
        "handles": Doubt("handles and further surfaces that the answer counts", 0.0, math.log1p),
        "crowded": Doubt("share of samples with an opposite sheet within 1.5 spacings", 0.0, _saturating),
        "crowded_wide": Doubt("the same within 2.5 spacings", 0.0, _saturating),
        "uncovered": Doubt("share of the samples off the surface that was found", 0.0, _saturating),
        "disagreement": Doubt("share of neighbors whose normals oppose each other", 0.0, _saturating),
        "roughness": Doubt("median distance of neighbors from the local plane, in spacings", 0.0, _itself),
        "rim": Doubt("share of samples with neighbors on one side only", 0.0, _saturating),
        "unconfirmed": Doubt("share of given normals that the points do not confirm", 0.0, _saturating),
    }
)


def cloud_confidence(witness: Witness, boundary: BoundaryEstimate) -> float:
    """Probability that the integer of a closed cloud is right, from 0 to 1.

    Calibrated on samples of shapes of known topology, whole shapes left out; see docs/accuracy.md.
    """
    measured = cloud_evidence(witness, boundary)
    log_odds = INTERCEPT - sum(one.coefficient * one.doubt(measured[name]) for name, one in EVIDENCE.items())
    return 1 / (1 + math.exp(-log_odds))


def cloud_evidence(witness: Witness, boundary: BoundaryEstimate) -> dict[str, float]:
    """The measured values of all evidence about a closed cloud."""
    quality, confirmed = witness.quality, witness.signs.confirmed
    values = [value for vote in witness.votes for value in vote.eulers]
    n_surfaces = witness.components + witness.cavities
    fields = values_of(witness.votes, "field")
    return {
        "cuts": _other_share(values_of(witness.votes, "cut"), witness.euler),
        "others": _other_share(values_of(witness.votes, "smooth cut", "coarse cut"), witness.euler),
        "fields": _other_share(fields, witness.euler),
        "no_fields": float(not fields),
        "spread": float(max(values) - min(values)),
        "handles": max(n_surfaces - witness.euler / 2, 0.0) + max(n_surfaces - 1, 0),
        "crowded": quality.crowded,
        "crowded_wide": quality.crowded_wide,
        "uncovered": 1 - quality.coverage,
        "disagreement": quality.disagreement,
        "roughness": quality.roughness,
        "rim": boundary.rim_share,
        "unconfirmed": 0.0 if confirmed is None else 1 - confirmed,
    }


def _other_share(values: list[int], euler: int) -> float:
    return 1 - values.count(euler) / len(values) if values else 0.0
