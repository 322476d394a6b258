"""How far an answer may be believed: one rule per kind of evidence, and a table of every threshold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

from topokit.core.cloud.evidence import Witness
from topokit.core.cloud.sheets import SheetReading
from topokit.core.cloud.solid.uncovered import UncoveredPatch
from topokit.core.cloud.solid.wires import WireReading
from topokit.core.cloud.votes import CUT_FAMILIES, share_of, values_of
from topokit.core.local.boundary import BoundaryEstimate
from topokit.report.confidence import cloud_confidence

if TYPE_CHECKING:
    from topokit.core.opacity.solid import OpacityReading

Verdict = Literal["certain", "likely", "unsure"]
Bound = Literal["at least", "at most"]


@dataclass(frozen=True)
class Threshold:
    """One limit.

    Attributes:
        value: the limit.
        bound: on which side of it a measured value must lie.
        unit: its unit.
        meaning: what is compared with it.
        source: the experiment or argument it comes from.
    """

    value: float
    bound: Bound
    unit: str
    meaning: str
    source: str

    def allows(self, value: float) -> bool:
        """Whether a measured value is within the limit."""
        return value >= self.value if self.bound == "at least" else value <= self.value


_CALIBRATED = (
    "of 267 answers to draws from real, random and planted shapes of 150 to 40 000 points, each judged by a model that "
    "has not seen its family, 135 reach it with both families of votes; none of these is wrong about features wider "
    "than its resolution (benchmarks/confidence.py)"
)
_ONE_DRAW = (
    "set so that at least 95 % of the likely answers are right on one draw (seed 0) of 10 000 points from each of 47 "
    "clean meshes, oriented, unoriented and noisy; checked on a second draw (docs/accuracy.md)"
)
_TUBES = (
    "67 tubes along random graphs, knots, polyhedra, helices and chained rings, radius 0.3 to 1.6 spacings, "
    "1 500 to 4 000 points"
)
_CUT = (
    "115 open clouds that planes, boxes and spheres cut from closed meshes, 5 000 to 30 000 random points before: 41 "
    "are likely; four of these lack features narrower than their resolution (benchmarks/open_clouds.py)"
)
_SPLATS = (
    "40 trained scenes, 47 meshes as 8 000 splats: eight unsure answers become likely, all right, and "
    "two likely ones unsure, both wrong (benchmarks/trained_splats.py, docs/accuracy.md)"
)
_ANALYTIC = "hemispheres, caps, cylinders, half tori and squares with and without holes, 1 000 to 10 000 points"

THRESHOLDS: Mapping[str, Threshold] = MappingProxyType(
    {
        "confidence": Threshold(
            0.98, "at least", "probability", "that a closed cloud's integer is right at its resolution", _CALIBRATED
        ),
        "points": Threshold(150, "at least", "points", "distinct points", "the calibration has no fewer"),
        "cuts": Threshold(0.7, "at least", "share of counts", "Delaunay cuts that give the integer", _ONE_DRAW),
        "fields": Threshold(
            0.65, "at least", "share of fields", "winding-number fields that give the integer, 0 of none", _ONE_DRAW
        ),
        "coarse": Threshold(
            0.75,
            "at least",
            "share of counts",
            "Delaunay cuts of half as many samples that give the integer, if a place is doubtful: where none is, "
            "fewer samples just see less",
            _CALIBRATED,
        ),
        "coverage": Threshold(0.6, "at least", "share of samples", "samples on the surface that was found", _ONE_DRAW),
        "double": Threshold(
            0.15,
            "at most",
            "share of neighborhoods",
            "points that look like two sheets that were taken for one",
            "closed real meshes, 10 000 random points: at most 0.11 (a thin tube); shells with walls of 0.3 to 0.6 "
            "spacings, taken for solids by all votes: at least 0.27 (benchmarks/planted.py)",
        ),
        "confirmed": Threshold(0.9, "at least", "share of normals", "given normals that the points confirm", _ONE_DRAW),
        "rim": Threshold(
            0.05,
            "at most",
            "share of samples",
            "samples with neighbors on one side only",
            "46 closed real meshes, 10 000 random points: at most 0.083 (plain) and 0.034 (0.5 % noise), 0.005 on "
            "smooth ones; scan lines on a sphere exceed it",
        ),
        "rounding": Threshold(
            0.5,
            "at most",
            "sample spacings",
            "step between neighboring coordinates in single precision",
            "clouds of 4 000 to 6 000 points from five shapes, rounded to steps of 0.1 to 4 spacings: all right at "
            "1 spacing, two of two at 1.5, from 2 on five of six were wrong; the limit is half of the first",
        ),
        "capped": Threshold(
            0.35,
            "at most",
            "share of area",
            "lids over the holes of the closed surface that was found; above it, the cloud is an open sheet",
            "a hemisphere's lid is 0.33 of its closed surface, that of a flat sheet 0.5",
        ),
        "balls": Threshold(
            0.8,
            "at least",
            "share of weight",
            "radii of the union of balls around the samples of an open cloud that give its integer",
            _CUT,
        ),
        "opacity": Threshold(
            0.75,
            "at least",
            "share of readings",
            "readings of the solid that cannot be seen into that give an integer",
            _SPLATS,
        ),
        "hidden": Threshold(
            0.02,
            "at most",
            "share of discs",
            "discs that lie inside that solid, two spacings below its surface: walls of what cannot be seen",
            _SPLATS,
        ),
        "finer": Threshold(
            0.65,
            "at most",
            "ratio of widths",
            "narrowest feature that opacity can see, over that of the samples, where their integers differ",
            "trained scenes in which only opacity is right: at most 0.62; splats wider than 0.8 spacings, "
            "which fill tunnels: at least 0.69",
        ),
        "wire_share": Threshold(
            0.3, "at least", "share of weight", "radii of the union of balls that give the integer of a wire", _TUBES
        ),
        "wire_contrast": Threshold(3, "at least", "ratio", "weight of a wire's integer over that of the next", _TUBES),
        "wire_range": Threshold(
            2, "at least", "ratio of radii", "range of radii over which the wire's integer stands", _TUBES
        ),
        "wire_narrowness": Threshold(
            0.25,
            "at most",
            "ratio of variances",
            "median second over first variance of 100 neighbors of a wire",
            _TUBES,
        ),
        "overlap": Threshold(
            0.04,
            "at most",
            "share of area",
            "area of a closed mesh off the solid it encloses; above it, the mesh is reported to overlap itself",
            "closed real meshes: at most 0.008 without self-intersections and 0.024 with few; 0.093 with walls thinner "
            "than the grid, 0.24 for two overlapping spheres",
        ),
    }
)

_OF_SAMPLES = ("confidence", "coarse", "coverage", "rim", "boundary")
"""Checks of how well samples alone show the surface for which both families of votes are."""

OF_CLOUD = ("averaged", "double", "rounding")
"""Checks of an open cloud that are the same for all surfaces that it may be of."""

CONDITIONS: Mapping[str, str] = MappingProxyType(
    {
        "genus": "there is a surface, and its integer is not too large for the number of surfaces",
        "boundary": "no curve looks like a boundary",
        "contradictory": "the given normals do not contradict each other",
        "pieces": "the union of balls around the samples of an open cloud has as many parts",
        "rims": "an open cloud has a rim for each part that encloses no space",
        "ring": "planar caps over the holes give the same genus as discs",
        "averaged": "an open cloud was not averaged: a plate thinner than its noise would look the same",
    }
)
"""Checks without a limit."""


@dataclass(frozen=True)
class Check:
    """One condition of a verdict: an answer is likely only if all are met.

    Attributes:
        name: a key of `THRESHOLDS` or `CONDITIONS`.
        value: the measured number.
        passed: whether it is within the limit.
    """

    name: str
    value: float
    passed: bool


def mesh_verdict(is_manifold: bool, is_closed: bool, exact_vertices: bool) -> Verdict:
    """A manifold mesh, closed or with boundary, is proven by counting, unless it is a guess which vertices are one.

    Args:
        is_manifold: whether every edge has one or two faces and every vertex one fan.
        is_closed: whether every edge has two.
        exact_vertices: False if nearly equal vertices were merged, which closes the mesh, or if different vertices on
            the boundary (nearly) coincide.
    """
    if not is_manifold:
        return "unsure"
    if exact_vertices:
        return "certain"
    return "likely" if is_closed else "unsure"


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


def proof_verdict(*, is_complete: bool, reaches_box: bool) -> Verdict:
    """A level set is certain if bounds of the function and its gradient prove its topology and the box does not cut it.

    Args:
        is_complete: whether no cell of the proof is left open.
        reaches_box: whether the level set is cut by the box: then only the part inside is known.
    """
    return "certain" if is_complete and not reaches_box else "unsure"


def cloud_verdict(checks: tuple[Check, ...]) -> Verdict:
    """A cloud is likely if all conditions are met: for closed ones both families of votes, for open ones balls, too."""
    return "likely" if all(check.passed for check in checks) else "unsure"


def cloud_checks(witness: Witness, boundary: BoundaryEstimate) -> tuple[Check, ...]:
    """The conditions under which the integer of a closed cloud is likely."""
    euler = witness.euler
    surfaces = float(witness.components + witness.cavities - euler / 2)
    checks = [
        _check("confidence", cloud_confidence(witness)),
        Check("genus", surfaces, witness.has_genus),
        _check("cuts", share_of(euler, values_of(witness.votes, *CUT_FAMILIES))),
        _check("fields", share_of(euler, values_of(witness.votes, "field"))),
        *_unless_passed("coarse", share_of(euler, values_of(witness.votes, "coarse cut"))),
        _check("coverage", witness.quality.coverage),  # noise hides the surface below
        _check("rim", boundary.rim_share),  # the calibration has no points along lines
        *_unless_passed("double", witness.quality.double),
        *_unless_passed("points", float(witness.n_used)),
        *_unless_passed("rounding", witness.rounding / witness.spacing),
    ]
    if boundary.curves:
        checks.append(Check("boundary", float(len(boundary.curves)), False))
    if witness.signs.source == "contradictory":
        checks.append(Check("contradictory", 1 - (witness.signs.confirmed or 0.0), False))
    elif witness.signs.confirmed is not None:
        checks.append(_check("confirmed", witness.signs.confirmed))
    return tuple(checks)


def without_doubts(checks: tuple[Check, ...]) -> tuple[Check, ...]:
    """The checks of a closed cloud without narrow places: fewer samples, which see less, may count otherwise."""
    return tuple(check for check in checks if check.name != "coarse")


def with_opacity(checks: tuple[Check, ...], seen: OpacityReading, witness: Witness) -> tuple[Check, ...]:
    """The checks of a closed cloud of splats with those of the solid that cannot be seen into.

    Where that solid has the integer, too, two witnesses agree that share nothing but the splats, and what made the
    samples alone doubtful no longer counts. A likely integer is doubtful if that solid contradicts it.

    Args:
        checks: of the samples alone.
        seen: what opacity says.
        witness: the evidence of the samples.
    """
    found = (_check("opacity", share_of(witness.euler, seen.eulers)), *_unless_passed("hidden", seen.hidden))
    agrees = cloud_verdict(found) == "likely"
    if cloud_verdict(checks) == "likely":
        return (*checks, *found) if agrees or opacity_contradicts(seen, witness) else checks
    return (*found, *(check for check in checks if check.name not in _OF_SAMPLES)) if agrees else (*checks, *found)


def opacity_contradicts(seen: OpacityReading, witness: Witness) -> bool:
    """Whether what cannot be seen into has another integer than the samples, and shows finer features."""
    return seen.euler != witness.euler and _shows_more(seen, witness)


def opacity_decides(seen: OpacityReading, witness: Witness, *, is_open: bool) -> bool:
    """Whether the integer of what cannot be seen into is the better one: all readings give it, and show finer features.

    Args:
        seen: what opacity says.
        witness: the evidence of the samples.
        is_open: whether the samples have holes; if not, their integer must be another one.
    """
    is_settled = seen.share == 1 and seen.surface is not None
    return is_settled and _shows_more(seen, witness) and (is_open or seen.euler != witness.euler)


def _shows_more(seen: OpacityReading, witness: Witness) -> bool:
    limits = ("opacity", seen.share), ("hidden", seen.hidden), ("finer", seen.resolution / witness.resolution)
    return all(THRESHOLDS[name].allows(value) for name, value in limits)


def open_checks(
    euler: int,
    components: int,
    n_rims: int,
    sheet: SheetReading | None,
    witness: Witness | None,
    *,
    has_ring: bool = False,
) -> tuple[Check, ...]:
    """The conditions under which the integer of an open cloud is likely.

    Args:
        euler: that of the found surface without its lids, or of the traced rims and the curvature.
        components: parts of that surface.
        n_rims: its known rims.
        sheet: the union of balls around the samples, or None if these are too few.
        witness: what was found of a closed surface, or None if there is none.
        has_ring: whether a planar cap has several rims, so that the genus is another one than with discs.
    """
    if sheet is None:
        return (Check("points", 0.0, False),)
    checks = [
        _check("balls", sheet.shares.get(euler, 0.0)),
        Check("pieces", float(sheet.components), sheet.components == components),
        Check("rims", float(n_rims), n_rims >= max(components - sheet.closed, 1)),
        Check("ring", float(has_ring), not has_ring),
    ]
    if witness is not None:
        is_averaged = witness.preparation == "averaged"
        checks.append(Check("averaged", float(is_averaged), not is_averaged))
        checks += _unless_passed("double", witness.quality.double)
        checks += _unless_passed("rounding", witness.rounding / witness.spacing)
    return tuple(checks)


def lasting_euler(sheet: SheetReading, traced: int) -> int:
    """The χ of an open cloud: that of the union of balls if it stands for nearly all radii, or else that of its rims.

    Of 20 cut clouds on which they differ, balls are right on eleven, rims on two.
    """
    value, share = next(iter(sheet.shares.items()))
    return value if THRESHOLDS["balls"].allows(share) else traced


def wire_checks(witness: Witness, wire: WireReading) -> tuple[Check, ...]:
    """The conditions under which the integer of a cloud that is read as a thickened graph is likely."""
    return (
        _check("wire_range", wire.largest / wire.smallest),
        _check("wire_share", wire.share),
        _check("wire_contrast", wire.contrast),
        _check("wire_narrowness", wire.narrowness),
        *_unless_passed("rounding", witness.rounding / witness.spacing),
    )


def lids(witness: Witness | None) -> tuple[UncoveredPatch, ...]:
    """The patches of the found surface that are lids over holes of the cloud, not gaps between random samples."""
    return () if witness is None else witness.lids


def is_mostly_seen(witness: Witness) -> bool:
    """Whether lids are the smaller part of the closed surface that was found, so that it bounds a solid with holes."""
    missing = missing_samples(witness)
    return THRESHOLDS["capped"].allows(missing / (witness.n_used + missing))


def missing_samples(witness: Witness | None) -> float:
    """How many samples would be expected on all lids."""
    return sum(patch.missing for patch in lids(witness))


def is_open(boundary: BoundaryEstimate, witness: Witness | None) -> bool:
    """Whether samples are of a surface with a boundary: there are holes in the cloud, or curves and no solid.

    Curves that look like a boundary, but where the found surface is covered by samples, run along thin edges or where
    the density of the samples changes.
    """
    return bool(lids(witness)) or (bool(boundary.curves) and is_sheet(witness))


def is_sheet(witness: Witness | None) -> bool:
    """Whether no solid was found, or one most of whose surface are lids."""
    return witness is None or witness.components == 0 or not is_mostly_seen(witness)


def overlaps(off_level: float) -> bool:
    """Whether a closed mesh intersects or overlaps itself, by the share of its area off the solid it encloses."""
    return not THRESHOLDS["overlap"].allows(off_level)


def _check(name: str, value: float) -> Check:
    return Check(name, value, THRESHOLDS[name].allows(value))


def _unless_passed(name: str, value: float) -> tuple[Check, ...]:
    """The check if it has failed: only then is there something to say."""
    check = _check(name, value)
    return () if check.passed else (check,)
