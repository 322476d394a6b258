"""How far an answer may be believed: one rule per kind of evidence, and a table of every threshold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

from topokit.core.cloud.findings import Witness
from topokit.core.cloud.uncovered import UncoveredPatch
from topokit.core.cloud.votes import CUT_FAMILIES, Family, values_of
from topokit.core.cloud.wires import WireReading
from topokit.core.local.boundary import BoundaryEstimate
from topokit.report.confidence import cloud_confidence

Verdict = Literal["certain", "likely", "unsure"]


@dataclass(frozen=True)
class Threshold:
    """One limit.

    Attributes:
        value: the limit.
        unit: its unit.
        meaning: what is compared with it.
        source: the experiment or argument it comes from.
    """

    value: float
    unit: str
    meaning: str
    source: str


_CALIBRATED = (
    "of 1 615 answers to draws from real and random shapes, each judged by a model that has not seen its shape, 1 163 "
    "reach it with both families of votes; 12 of these are wrong, 7 of them of 150 to 1 500 points; from 0.82 on "
    "2 % are (benchmarks/confidence.py)"
)
_ONE_DRAW = (
    "set so that at least 95 % of the likely answers are right on one draw (seed 0) of 10 000 points from each of 47 "
    "clean meshes, oriented, unoriented and noisy; checked on a second draw (docs/accuracy.md)"
)
_TUBES = (
    "67 tubes along random graphs, knots, polyhedra, helices and chained rings, radius 0.3 to 1.6 spacings, "
    "1 500 to 4 000 points"
)
_ANALYTIC = "hemispheres, caps, cylinders, half tori and squares with and without holes, 1 000 to 10 000 points"

THRESHOLDS: Mapping[str, Threshold] = MappingProxyType(
    {
        "confidence": Threshold(
            0.85, "probability", "that the integer of a closed cloud is right, at least", _CALIBRATED
        ),
        "cuts": Threshold(0.7, "share of counts", "Delaunay cuts that give the integer, at least", _ONE_DRAW),
        "fields": Threshold(
            0.65, "share of fields", "winding-number fields that give the integer, at least", _ONE_DRAW
        ),
        "agreement": Threshold(0.75, "share of weight", "votes for the integer, by weight, at least", _ONE_DRAW),
        "crowded": Threshold(
            0.009, "share of samples", "samples with an opposite sheet within 1.5 spacings, at most", _ONE_DRAW
        ),
        "crowded_wide": Threshold(
            0.0175, "share of samples", "samples with an opposite sheet within 2.5 spacings, at most", _ONE_DRAW
        ),
        "coverage": Threshold(0.6, "share of samples", "samples on the surface that was found, at least", _ONE_DRAW),
        "disagreement": Threshold(
            0.06, "share of neighbor pairs", "neighboring normals that oppose each other, at most", _ONE_DRAW
        ),
        "confirmed": Threshold(0.9, "share of normals", "given normals that the points confirm, at least", _ONE_DRAW),
        "rim": Threshold(
            0.05,
            "share of samples",
            "samples with neighbors on one side only, at most",
            "46 closed real meshes, 10 000 random points: at most 0.083 (plain) and 0.034 (0.5 % noise), 0.005 on "
            "smooth ones; scan lines on a sphere exceed it",
        ),
        "rounding": Threshold(
            0.5,
            "sample spacings",
            "step between neighboring coordinates in single precision, at most",
            "clouds of 4 000 to 6 000 points from five shapes, rounded to steps of 0.1 to 4 spacings: all right at "
            "1 spacing, two of two at 1.5, from 2 on five of six were wrong; the limit is half of the first",
        ),
        "uncovered": Threshold(
            25,
            "samples",
            "samples missing from a patch of the found surface from which it is a lid over a hole of the cloud",
            "a region where a random samples are expected is empty with probability exp(-a): a patch misses at "
            "most 15.8 in 60 draws of 20 000 on a plane, 17 in 10 000 points from 24 of 26 closed meshes (two "
            "have thin walls), and at least 48 in 24 of 26 clouds that planes, boxes and spheres cut from these",
        ),
        "open_length": Threshold(
            60,
            "sample spacings",
            "boundary length from which a cloud is an open sheet, not a solid with gaps",
            _ANALYTIC,
        ),
        "open_crowded": Threshold(
            0.05, "share of samples", "crowded samples from which curves along thin rims are no boundary", _ONE_DRAW
        ),
        "wire_share": Threshold(
            0.3, "share of weight", "radii of the union of balls that give the integer of a wire, at least", _TUBES
        ),
        "wire_contrast": Threshold(
            6,
            "ratio",
            "weight of a wire's integer over that of the next, at least, where no Delaunay cut gives it",
            _TUBES,
        ),
        "wire_contrast_supported": Threshold(
            3,
            "ratio",
            "weight of a wire's integer over that of the next, at least, where a Delaunay cut gives it",
            _TUBES,
        ),
        "wire_range": Threshold(
            2, "ratio of radii", "range of radii over which the wire's integer stands, at least", _TUBES
        ),
        "wire_narrowness": Threshold(
            0.25, "ratio of variances", "median second over first variance of 100 neighbors of a wire, at most", _TUBES
        ),
        "overlap": Threshold(
            0.04,
            "share of area",
            "area of a closed mesh off the solid it encloses from which it is reported to overlap itself",
            "closed real meshes: at most 0.008 without self-intersections and 0.024 with few; 0.093 with walls thinner "
            "than the grid, 0.24 for two overlapping spheres",
        ),
    }
)


@dataclass(frozen=True)
class Check:
    """One condition of a verdict.

    Attributes:
        name: what was compared.
        value: the measured number.
        passed: whether it is within the limit.
        decides: whether the verdict depends on it directly; if not, it is a part of the confidence.
    """

    name: str
    value: float
    passed: bool
    decides: bool = False


def mesh_verdict(is_closed: bool, exact_vertices: bool) -> Verdict:
    """A closed manifold mesh is proven by counting, unless it is closed only after a merge of nearly equal vertices."""
    if not is_closed:
        return "unsure"
    return "certain" if exact_vertices else "likely"


def volume_verdict() -> Verdict:
    """A binary volume is proven by counting, under its stated connectivity."""
    return "certain"


def function_verdict(
    is_converged: bool, *, has_distance: bool, n_unseen: int, reaches_box: bool, adds_up: bool
) -> Verdict:
    """A level set is likely once refinement changes nothing; no grid proves what lies between its points.

    Args:
        is_converged: whether both connectivities, three successive grids and shifted levels agree.
        has_distance: whether the values say how far the level set is, so that cells could be left out.
        n_unseen: places where the level is reached between vertices of the finest grid that are all on one side.
        reaches_box: whether the level set is cut by the box.
        adds_up: whether the surfaces of the grid that was kept sum to the integer.
    """
    sees_all = has_distance and n_unseen == 0 and not reaches_box
    return "likely" if is_converged and adds_up and sees_all else "unsure"


def cloud_verdict(checks: tuple[Check, ...]) -> Verdict:
    """A closed cloud is likely if both families of votes agree and such answers are nearly always right."""
    return "likely" if all(check.passed for check in checks if check.decides) else "unsure"


def cloud_checks(witness: Witness, boundary: BoundaryEstimate) -> tuple[Check, ...]:
    """The conditions under which the integer of a closed cloud is likely, and the evidence behind its confidence."""
    euler, quality = witness.euler, witness.quality
    confidence = cloud_confidence(witness)
    cuts = [value == euler for value in values_of(witness.votes, *CUT_FAMILIES)]
    surfaces = float(witness.components + witness.cavities - euler / 2)
    checks = [
        Check("confidence", confidence, confidence >= THRESHOLDS["confidence"].value, decides=True),
        Check("genus", surfaces, has_genus(witness), decides=True),
        replace(_at_least("cuts", sum(cuts) / len(cuts)), decides=True),
        *_second_opinions(witness),
        _at_least("agreement", witness.agreement),
        _at_most("crowded", quality.crowded),
        _at_most("crowded_wide", quality.crowded_wide),
        replace(_at_least("coverage", quality.coverage), decides=True),  # the calibration has no likely one below 0.74
        _at_most("disagreement", quality.disagreement),
        replace(_at_most("rim", boundary.rim_share), decides=True),  # the calibration has no points along lines
    ]
    if witness.signs.source == "contradictory":
        checks.append(Check("contradictory", 1 - (witness.signs.confirmed or 0.0), False, decides=True))
    elif witness.signs.confirmed is not None:
        checks.append(replace(_at_least("confirmed", witness.signs.confirmed), decides=True))
    checks += _rounding(witness)
    if witness.preparation == "thinned":  # the calibration has no such noise
        checks.append(Check("noise", float(witness.n_used), False, decides=True))
    if witness.smoothed is not None:
        checks.append(Check("second look", witness.smoothed.agreement, False, decides=True))
    return tuple(checks)


def _second_opinions(witness: Witness) -> tuple[Check, ...]:
    """What does not look at the samples of the first cuts: fields, smoothed samples, half as many samples."""
    euler, votes = witness.euler, witness.votes
    original, fields = values_of(votes, "cut")[0], values_of(votes, "field")
    checks = []
    if fields:
        checks.append(replace(_at_least("fields", fields.count(euler) / len(fields)), decides=True))
    others: tuple[tuple[str, Family], ...] = (("smoothing", "smooth cut"), ("convergence", "coarse cut"))
    for name, family in others:
        for value in values_of(votes, family)[:1]:
            checks.append(Check(name, float(value), original == value == euler))
    return tuple(checks)


def wire_checks(witness: Witness, wire: WireReading) -> tuple[Check, ...]:
    """The conditions under which the integer of a cloud that is read as a thickened graph is likely."""
    is_supported = witness.euler in values_of(witness.votes, "cut", "smooth cut")
    checks = (
        _at_least("wire_range", wire.largest / wire.smallest),
        _at_least("wire_share", wire.share),
        _at_least("wire_contrast_supported" if is_supported else "wire_contrast", wire.contrast),
        _at_most("wire_narrowness", wire.narrowness),
        *_rounding(witness),
    )
    return tuple(replace(check, decides=True) for check in checks)


def _rounding(witness: Witness) -> list[Check]:
    """A check that has failed, of coordinates that single precision has rounded; else none."""
    check = _at_most("rounding", witness.rounding / witness.spacing)
    return [] if check.passed else [replace(check, decides=True)]


def has_genus(witness: Witness) -> bool:
    """Whether the integer fits the number of surfaces, of which there must be one: a genus cannot be negative."""
    n_surfaces = witness.components + witness.cavities
    return n_surfaces > 0 and witness.euler <= 2 * n_surfaces


def lids(witness: Witness | None) -> tuple[UncoveredPatch, ...]:
    """The patches of the found surface that are lids over holes of the cloud, not gaps between random samples."""
    patches = () if witness is None else witness.uncovered
    return tuple(patch for patch in patches if patch.missing > THRESHOLDS["uncovered"].value)


def is_open_sheet(boundary: BoundaryEstimate, witness: Witness | None) -> bool:
    """Whether samples with a boundary are an open surface rather than a solid with gaps.

    The boundary is long and no opposite sheet is close; or no solid was found at all.
    """
    if witness is None:
        return True
    is_crowded = witness.quality.crowded_boundary > THRESHOLDS["open_crowded"].value
    return not is_crowded and boundary.length > THRESHOLDS["open_length"].value * boundary.spacing


def overlaps(off_level: float) -> bool:
    """Whether a closed mesh intersects or overlaps itself, by the share of its area off the solid it encloses."""
    return off_level > THRESHOLDS["overlap"].value


def _at_least(name: str, value: float) -> Check:
    return Check(name, value, value >= THRESHOLDS[name].value)


def _at_most(name: str, value: float) -> Check:
    return Check(name, value, value <= THRESHOLDS[name].value)
