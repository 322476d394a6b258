"""The rule of the global witness: which integer the settings stand for, and whether it may be believed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

Verdict = Literal["likely", "unsure"]

VOTE_WEIGHTS = {
    "cut 0": 1.5,
    "cut 1": 1.0,
    "cut 2": 1.0,
    "smooth cut 0": 1.25,
    "smooth cut 1": 1.0,
    "grid 0": 0.8,
    "grid 1": 0.8,
    "grid 2": 0.6,
}
"""Weight of each setting; a cut's weight is shared between its inside and its outside."""

_LEAST_CUTS = 0.7  # share of the cuts that stand behind the integer
_LEAST_GRIDS = 2
_LEAST_AGREEMENT = 0.75
_MOST_CROWDED = 0.009  # share of samples with an opposite sheet within 1.5 spacings
_MOST_CROWDED_WIDER = 0.0175  # within 2.5 spacings
_LEAST_COVERAGE = 0.6
_MOST_DISAGREEMENT = 0.06
_LEAST_CONFIRMED = 0.9


def decide(votes: Mapping[str, int], numbers: Mapping[str, float]) -> tuple[int, Verdict, tuple[str, ...], float]:
    """The integer of greatest weight, a verdict, its reasons as sentences, and the weight's share.

    "likely" asks that both families (cuts and grids) stand behind the integer, that the samples lie on the implied
    surface, that neighboring normals agree, that given normals are confirmed, and that almost no sample sees an
    opposite sheet nearer than the sampling resolves. The limits were set on real shapes sampled at 10 000 points so
    that at least 95 % of the "likely" answers are right.

    Args:
        votes: Euler characteristic of the surface per setting, as `witness.gather_votes` names them.
        numbers: measurements as `witness.gather_votes` names them; "given normals" only where normals were given.
    """
    euler, agreement = _heaviest(votes)
    cuts = [value == euler for name, value in votes.items() if "cut" in name]
    grids = [value == euler for name, value in votes.items() if "grid" in name]
    raw, smooth = votes["cut 0 inside"], votes["smooth cut 0 inside"]
    crowded, wider = numbers["crowded"], numbers["crowded 2.5"]
    checks = [
        (
            sum(cuts) >= _LEAST_CUTS * len(cuts),
            f"{sum(cuts)} of {len(cuts)} ways to fill the cloud with tetrahedra give χ = {euler}.",
            f"Only {sum(cuts)} of {len(cuts)} ways to fill the cloud with tetrahedra give χ = {euler}.",
        ),
        (
            sum(grids) >= _LEAST_GRIDS,
            f"{sum(grids)} of {len(grids)} winding-number fields give χ = {euler}.",
            f"Only {sum(grids)} of {len(grids)} winding-number fields give χ = {euler}.",
        ),
        (
            raw == smooth == euler,
            f"The points as they are and the points smoothed both give χ = {euler}.",
            f"The points as they are give χ = {raw}, smoothed they give {smooth}; the best answer is {euler}.",
        ),
        (
            agreement >= _LEAST_AGREEMENT,
            f"{agreement:.0%} of all evidence, by weight, gives χ = {euler}.",
            f"Only {agreement:.0%} of all evidence, by weight, gives χ = {euler}.",
        ),
        (
            crowded <= _MOST_CROWDED,
            f"{crowded:.2%} of the points see an opposite sheet nearer than 1.5 sample spacings.",
            f"{crowded:.1%} of the points see an opposite sheet nearer than 1.5 sample spacings: "
            "walls or gaps are thinner than the sampling resolves.",
        ),
        (
            wider <= _MOST_CROWDED_WIDER,
            f"{wider:.2%} of the points see an opposite sheet nearer than 2.5 sample spacings.",
            f"{wider:.1%} of the points see an opposite sheet nearer than 2.5 sample spacings, "
            "about the size of the smallest feature that can be told.",
        ),
        (
            numbers["coverage"] >= _LEAST_COVERAGE,
            f"{numbers['coverage']:.1%} of the points lie on the surface that was found.",
            f"Only {numbers['coverage']:.1%} of the points lie on the surface that was found.",
        ),
        (
            numbers["disagreement"] <= _MOST_DISAGREEMENT,
            f"{numbers['disagreement']:.2%} of neighboring normals oppose each other.",
            f"{numbers['disagreement']:.1%} of neighboring normals oppose each other: "
            "sheets lie close together, or the normals are not consistent.",
        ),
    ]
    if "given normals" in numbers:
        confirmed = numbers["given normals"]
        checks.append(
            (
                confirmed >= _LEAST_CONFIRMED,
                f"{confirmed:.1%} of the given normals point the way the points themselves say.",
                f"Only {confirmed:.1%} of the given normals point the way the points themselves say.",
            )
        )
    is_sure = all(good for good, _, _ in checks)
    reasons = tuple(yes if good else no for good, yes, no in checks)
    return euler, "likely" if is_sure else "unsure", reasons, agreement


def _heaviest(votes: Mapping[str, int]) -> tuple[int, float]:
    """The value of greatest weight (of equal ones that nearest to zero) and its share of the whole."""
    weight: dict[int, float] = {}
    total = 0.0
    for name, value in votes.items():
        share = VOTE_WEIGHTS[name.replace(" inside", "").replace(" outside", "")] / (2 if "cut" in name else 1)
        weight[value] = weight.get(value, 0.0) + share
        total += share
    euler = max(weight, key=lambda value: (weight[value], -abs(value)))
    return euler, weight[euler] / total
