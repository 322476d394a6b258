"""What would help most where the report of a cloud is unsure: one sentence, from the evidence of the report."""

from __future__ import annotations

from collections.abc import Sequence

from topokit.core.cloud.evidence import Witness
from topokit.report.doubts import is_noisy
from topokit.report.verdict import THRESHOLDS, Check

_AFTER = {
    "rounding": "Subtract an offset before the coordinates are stored, or store them in double precision.",
    "contradictory": "Leave out the normals: others are found from the points.",
    "confirmed": "Leave out the normals: others are found from the points.",
    "rim": "Points that are spread evenly would help most, not along lines.",
}
"""By the name of a check that failed, the first one first."""


def cloud_advice(witness: Witness | None, n_points: int, checks: Sequence[Check] = ()) -> str | None:
    """What would make the answer surer, or show narrower features; None if nothing is known to help.

    Args:
        witness: what was found of a closed surface, or None.
        n_points: number of samples.
        checks: those of the verdict.
    """
    if n_points < THRESHOLDS["points"].value:
        return f"At least {THRESHOLDS['points'].value:.0f} distinct points are needed, {4 * n_points} are better."
    if witness is None:
        return None
    failed = {check.name for check in checks if not check.passed}
    for name, sentence in _AFTER.items():
        if name in failed:
            return sentence
    has_no_normals = witness.signs.source == "none"
    if is_noisy(witness):
        return f"Less noise would help most{', or normals that were measured with the points' * has_no_normals}."
    normals = "; normals with the points help, too" * has_no_normals
    return f"More points would help most: about {4 * witness.n_points} show features half as wide{normals}."
