"""Confidence: 1 of what is certain, and of a point cloud the probability by a logistic model of the evidence."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from topokit.core.cloud.evidence import Witness
from topokit.core.cloud.votes import CUT_FAMILIES, Family, share_of, values_of

SCALES: Mapping[str, Callable[[float], float]] = MappingProxyType(
    {
        "x": lambda x: x,
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


INTERCEPT = 7.80  # log-odds of an answer without any doubt

EVIDENCE: Mapping[str, Doubt] = MappingProxyType(
    {
        "cuts": Doubt("share of the Delaunay cuts of the samples that give another integer", "x", 2.34),
        "coarse": Doubt("share of the Delaunay cuts of half as many samples that give another integer", "x", 2.68),
        "fields": Doubt("share of the winding-number fields that do not give the integer; 1 if none votes", "x", 0.47),
        "crowded_wide": Doubt("share of samples with an opposite sheet within 2.5 spacings", "log(1 + 100 x)", 0.75),
        "off_surface": Doubt(
            "share of the samples off the surface, beyond what noise explains", "log(1 + 100 x)", 0.67
        ),
    }
)


_NOISE = 0.1  # roughness, in spacings, from which most samples are off any surface by noise alone


def counted_confidence(verdict: str) -> float | None:
    """Confidence of a counted or bounded answer: 1 if it is certain, else None, for which none was calibrated."""
    return 1.0 if verdict == "certain" else None


def cloud_confidence(witness: Witness) -> float:
    """Probability that the integer of a closed cloud counts all features wider than the resolution, from 0 to 1.

    It is 0 if no closed surface has that integer. Calibrated on samples of shapes of known topology, whole families of
    shapes left out; see docs/accuracy.md.
    """
    if not witness.has_genus:
        return 0.0
    measured = cloud_evidence(witness)
    log_odds = INTERCEPT - sum(one.coefficient * one.of(measured[name]) for name, one in EVIDENCE.items())
    return 1 / (1 + math.exp(-log_odds))


def cloud_evidence(witness: Witness) -> dict[str, float]:
    """The measured values of all evidence about a closed cloud."""
    quality = witness.quality

    def against(*families: Family) -> float:
        return 1 - share_of(witness.euler, values_of(witness.votes, *families))

    return {
        "cuts": against(*CUT_FAMILIES),
        "coarse": against("coarse cut"),
        "fields": against("field"),
        "crowded_wide": quality.crowded_wide,
        "off_surface": (1 - quality.coverage) / (1 + (quality.roughness / _NOISE) ** 2),
    }
