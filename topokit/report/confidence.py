"""The probability that the integer of a point cloud is right: a logistic model of the evidence."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from topokit.core.cloud.findings import Witness
from topokit.core.cloud.votes import CUT_FAMILIES, share_of, values_of

SCALES: Mapping[str, Callable[[float], float]] = MappingProxyType(
    {
        "x": lambda x: x,
        "log(1 + x)": math.log1p,
        "log(1 + 100 x)": lambda x: math.log1p(100 * x),  # for shares: twice as much than 1 % is not twice as bad
    }
)
"""The doubt that a measured value x gives; 0 for 0."""


@dataclass(frozen=True)
class Doubt:
    """One kind of evidence against an answer.

    Attributes:
        meaning: what is measured.
        scale: the doubt that a measured value gives, one of `SCALES`.
        coefficient: log-odds lost per unit of doubt.
    """

    meaning: str
    scale: str
    coefficient: float

    def of(self, value: float) -> float:
        """The doubt that a measured value gives."""
        return SCALES[self.scale](value)


INTERCEPT = 5.72  # log-odds of an answer without any doubt

EVIDENCE: Mapping[str, Doubt] = MappingProxyType(
    {
        "cuts": Doubt("share of the Delaunay cuts of the points that give another integer", "x", 1.73),
        "fields": Doubt("share of the winding-number fields that do not give the integer; 1 if none votes", "x", 1.12),
        "handles": Doubt("handles and further surfaces that the answer counts", "log(1 + x)", 0.67),
        "crowded_wide": Doubt("share of samples with an opposite sheet within 2.5 spacings", "log(1 + 100 x)", 0.91),
        "off_surface": Doubt(
            "share of the samples off the surface, beyond what noise explains", "log(1 + 100 x)", 0.79
        ),
    }
)

_NOISE = 0.1  # roughness, in spacings, from which most samples are off any surface by noise alone


def cloud_confidence(witness: Witness) -> float:
    """Probability that the integer of a closed cloud is right, from 0 to 1.

    Calibrated on samples of shapes of known topology, whole shapes left out; see docs/accuracy.md.
    """
    measured = cloud_evidence(witness)
    log_odds = INTERCEPT - sum(one.coefficient * one.of(measured[name]) for name, one in EVIDENCE.items())
    return 1 / (1 + math.exp(-log_odds))


def cloud_evidence(witness: Witness) -> dict[str, float]:
    """The measured values of all evidence about a closed cloud."""
    quality, n_surfaces = witness.quality, witness.components + witness.cavities
    return {
        "cuts": 1 - share_of(witness.euler, values_of(witness.votes, *CUT_FAMILIES)),
        "fields": 1 - share_of(witness.euler, values_of(witness.votes, "field")),
        "handles": max(n_surfaces - witness.euler / 2, 0.0) + max(n_surfaces - 1, 0),
        "crowded_wide": quality.crowded_wide,
        "off_surface": (1 - quality.coverage) / (1 + (quality.roughness / _NOISE) ** 2),
    }
