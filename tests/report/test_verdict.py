"""Every rule of the verdict beside its threshold, on witnesses made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from witnesses import a_wire, a_witness, votes_of

import topokit as tk
from topokit.core.cloud.given_normals import Signs
from topokit.core.cloud.sheets import SheetReading
from topokit.core.cloud.solid.uncovered import UncoveredPatch
from topokit.core.cloud.votes import Vote
from topokit.core.local.boundary import BoundaryCurve, BoundaryEstimate
from topokit.core.opacity.solid import OpacityReading
from topokit.core.surface import TriangleSurface
from topokit.report.cloud_wording import check_sentences, open_sentences
from topokit.report.confidence import EVIDENCE, cloud_confidence
from topokit.report.open_surface import OpenSurface
from topokit.report.verdict import (
    CONDITIONS,
    THRESHOLDS,
    cloud_checks,
    cloud_verdict,
    function_verdict,
    is_mostly_seen,
    is_open,
    is_sheet,
    lasting_euler,
    lids,
    mesh_verdict,
    opacity_contradicts,
    opacity_decides,
    open_checks,
    overlaps,
    volume_verdict,
    wire_checks,
    with_opacity,
    without_doubts,
)
from topokit.testing import torus_samples


def limit(name: str) -> float:
    return THRESHOLDS[name].value


def rim(share: float = 0.0, length: float | None = None) -> BoundaryEstimate:
    """Samples a unit apart with one boundary curve, if it has a length."""
    curves = () if length is None else (BoundaryCurve(torch.arange(30), length, 0.0),)
    return BoundaryEstimate(curves, share, 1.0)


def split(family: str, right: int, wrong: int) -> dict[str, Any]:
    """Votes of which a family gives the integer 2 so often and the integer 0 so often; the other family agrees."""
    other = "field" if family == "cut" else "cut"
    return {
        "votes": votes_of({other: 2, "coarse cut": 2})
        + votes_of({family: 2})[:1] * right
        + votes_of({family: 0})[:1] * wrong
    }


def halves(right: int, wrong: int) -> tuple[Vote, ...]:
    """Votes of half as many samples: so many give the integer 2, so many the integer 0."""
    return tuple(Vote("coarse cut", k, (2 if k < right else 0,)) for k in range(right + wrong))


# name of the check: (what just meets it, what just fails it), each the changes of a witness and a boundary
CLOUD_RULES: dict[str, tuple[tuple[dict[str, Any], BoundaryEstimate], tuple[dict[str, Any], BoundaryEstimate]]] = {
    "cuts": ((split("cut", 7, 3), rim()), (split("cut", 69, 31), rim())),
    "fields": ((split("field", 65, 35), rim()), (split("field", 64, 36), rim())),
    "coarse": (
        ({"votes": votes_of({"cut": 2, "field": 2}) + halves(6, 2)}, rim()),
        ({"votes": votes_of({"cut": 2, "field": 2}) + halves(5, 2)}, rim()),
    ),
    "coverage": (
        ({"quality": {"coverage": 0.6, "roughness": 0.5}}, rim()),
        ({"quality": {"coverage": 0.59, "roughness": 0.5}}, rim()),
    ),
    "double": (({"quality": {"double": 0.15}}, rim()), ({"quality": {"double": 0.151}}, rim())),
    "confirmed": (({"signs": Signs("given", 0.9, None)}, rim()), ({"signs": Signs("given", 0.89, None)}, rim())),
    "rim": (({}, rim(0.05)), ({}, rim(0.051))),
    "points": (({"n_used": 150}, rim()), ({"n_used": 149}, rim())),
    "rounding": (({"rounding": 0.5}, rim()), ({"rounding": 0.51}, rim())),
    "boundary": (({}, rim()), ({}, rim(length=30.0))),
    "genus": (({"components": 1}, rim()), ({"components": 0, "cavities": 0}, rim())),
    "contradictory": (({}, rim()), ({"signs": Signs("contradictory", 0.6, 1.0)}, rim())),
}


@pytest.mark.parametrize("name", CLOUD_RULES)
def test_each_rule_of_clouds_decides_alone_at_its_limit(name: str) -> None:
    (met, near), (broken, far) = CLOUD_RULES[name]
    good, bad = a_witness(**met), a_witness(**broken)
    checks = {check.name: check for check in cloud_checks(good, near)}
    assert name not in checks or checks[name].passed
    failed = {check.name for check in cloud_checks(bad, far) if not check.passed}
    assert name in failed
    assert failed <= {name, "confidence"}  # evidence of the confidence is a rule of its own for votes and coverage
    assert cloud_verdict(cloud_checks(bad, far)) == "unsure"


def test_the_confidence_decides_alone() -> None:
    crowded = a_witness(quality={"crowded_wide": 1.0, "coverage": 0.6, "roughness": 0.1})
    assert cloud_confidence(crowded) < limit("confidence") < cloud_confidence(a_witness())
    assert {check.name for check in cloud_checks(crowded, rim()) if not check.passed} == {"confidence"}
    assert cloud_verdict(cloud_checks(crowded, rim())) == "unsure"


def test_fewer_samples_may_count_otherwise_where_nothing_is_narrow() -> None:
    seen = a_witness(votes=votes_of({"cut": 2, "field": 2}) + halves(5, 3))
    checks = cloud_checks(seen, rim())
    assert {check.name for check in checks if not check.passed} == {"coarse"}
    assert cloud_verdict(without_doubts(checks)) == "likely"
    shadowed = a_witness(votes=votes_of({"cut": 2}) + halves(5, 3))
    assert cloud_verdict(without_doubts(cloud_checks(shadowed, rim()))) == "unsure"


def test_agreement_of_one_family_is_not_likely() -> None:
    cuts_alone = a_witness(votes={"cut": 2, "coarse cut": 2})
    checks = cloud_checks(cuts_alone, rim())
    assert "fields" in {check.name for check in checks if not check.passed}
    assert cloud_verdict(checks) == "unsure"
    [sentence] = [text for text in check_sentences(checks, cuts_alone)[0] if "field" in text]
    assert "no" in sentence.lower().split()
    assert cloud_verdict(cloud_checks(a_witness(), rim())) == "likely"


WIRE_RULES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "wire_range": ({"largest": 2.0}, {"largest": 1.99}),
    "wire_share": ({"share": 0.3}, {"share": 0.29}),
    "wire_contrast": ({"contrast": 3.0}, {"contrast": 2.9}),
    "wire_narrowness": ({"narrowness": 0.25}, {"narrowness": 0.26}),
}


@pytest.mark.parametrize("name", WIRE_RULES)
def test_each_rule_of_wires_decides_alone_at_its_limit(name: str) -> None:
    met, broken = WIRE_RULES[name]
    seen = a_witness(votes=())
    assert cloud_verdict(wire_checks(seen, a_wire(**met))) == "likely"
    checks = wire_checks(seen, a_wire(**broken))
    assert {check.name for check in checks if not check.passed} == {name}
    assert cloud_verdict(checks) == "unsure"


OPEN_RULES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "balls": ({"shares": {1: 0.8, 0: 0.2}}, {"shares": {1: 0.79, 0: 0.21}}),
    "pieces": ({}, {"components": 3}),
    "rims": ({"closed": 1}, {"closed": 0}),
}
"""Of two parts with χ = 1 and one rim."""


AN_OPEN_SURFACE = OpenSurface(components=2, euler=1, rims=(np.zeros((3, 3)),), of_sheet=False)


def a_sheet(**changed: Any) -> SheetReading:
    return SheetReading(**({"shares": {1: 1.0}, "components": 2, "closed": 1} | changed))


@pytest.mark.parametrize("name", OPEN_RULES)
def test_each_rule_of_open_clouds_decides_alone_at_its_limit(name: str) -> None:
    met, broken = OPEN_RULES[name]
    assert cloud_verdict(open_checks(1, 2, 1, a_sheet(**met), a_witness())) == "likely"
    checks = open_checks(1, 2, 1, a_sheet(**broken), None)
    assert {check.name for check in checks if not check.passed} == {name}
    assert cloud_verdict(checks) == "unsure"
    assert all(
        "{" not in sentence for part in open_sentences(checks, a_sheet(**broken), AN_OPEN_SURFACE) for sentence in part
    )


def test_open_clouds_have_a_rim_and_enough_samples() -> None:
    assert cloud_verdict(open_checks(1, 1, 0, a_sheet(components=1, closed=1), None)) == "unsure"
    assert cloud_verdict(open_checks(1, 1, 1, None, None)) == "unsure"
    ring = open_checks(1, 2, 1, a_sheet(), None, has_ring=True)
    assert [check.name for check in ring if not check.passed] == ["ring"]
    assert all("{" not in line for part in open_sentences(ring, a_sheet(), AN_OPEN_SURFACE) for line in part)
    two_sheets = a_witness(quality={"double": limit("double") + 0.01})
    assert cloud_verdict(open_checks(1, 2, 1, a_sheet(), two_sheets)) == "unsure"
    noisy = open_checks(1, 2, 1, a_sheet(), a_witness(preparation="averaged"))
    assert [check.name for check in noisy if not check.passed] == ["averaged"]


def test_balls_decide_where_they_last() -> None:
    assert lasting_euler(a_sheet(shares={0: 0.8, 1: 0.2}), 1) == 0
    assert lasting_euler(a_sheet(shares={0: 0.79, 1: 0.21}), 1) == 1


def test_every_threshold_is_a_rule_that_is_tested_here() -> None:
    elsewhere = {"confidence", "overlap", "capped", "opacity", "hidden", "finer"}
    elsewhere |= {"ring", "averaged"}
    assert {*CLOUD_RULES, *WIRE_RULES, *OPEN_RULES, *elsewhere} == {*THRESHOLDS, *CONDITIONS}
    assert not set(EVIDENCE) & {"agreement", "crowded", "disagreement"}


def seen_as(euler: int, n_readings: int = 16, **values: float) -> OpacityReading:
    """A reading of opacity in which so many of 16 give an integer and the others −8; twice as fine as a witness."""
    eulers = (euler,) * n_readings + (-8,) * (16 - n_readings)
    given = {"hidden": 0.0, "resolution": a_witness().resolution / 2} | values
    surface = TriangleSurface(np.zeros((3, 3)), np.arange(3)[None])
    return OpacityReading(eulers, euler, n_readings / 16, surface=surface, seconds=0.0, **given)


def test_opacity_agrees_if_enough_readings_have_the_integer_and_few_discs_are_hidden() -> None:
    doubtful, contradicted = a_witness(quality={"coverage": 0.0}), a_witness(**split("cut", 1, 9))
    enough = int(16 * limit("opacity"))
    for witness, seen, verdict in (
        (doubtful, seen_as(doubtful.euler, enough), "likely"),
        (doubtful, seen_as(doubtful.euler, enough - 1), "unsure"),
        (doubtful, seen_as(doubtful.euler, hidden=limit("hidden")), "likely"),
        (doubtful, seen_as(doubtful.euler, hidden=1.01 * limit("hidden")), "unsure"),
        (contradicted, seen_as(contradicted.euler), "unsure"),  # most votes of the samples are needed still
    ):
        assert cloud_verdict(with_opacity(cloud_checks(witness, rim()), seen, witness)) == verdict


def test_opacity_contradicts_a_likely_integer_if_it_shows_finer_features() -> None:
    witness = a_witness()
    finest = limit("finer") * witness.resolution
    enough = int(16 * limit("opacity"))
    for seen, contradicts, decides in (
        (seen_as(0, resolution=finest), True, True),
        (seen_as(0, enough, resolution=finest), True, False),
        (seen_as(0, enough - 1), False, False),
        (seen_as(0, resolution=1.01 * finest), False, False),
        (seen_as(0, hidden=1.01 * limit("hidden")), False, False),
        (seen_as(witness.euler), False, False),
    ):
        assert opacity_contradicts(seen, witness) is contradicts
        assert opacity_decides(seen, witness, is_open=False) is decides
        checks = with_opacity(cloud_checks(witness, rim()), seen, witness)
        assert cloud_verdict(checks) == ("unsure" if contradicts else "likely")
    same = seen_as(witness.euler, resolution=finest)
    assert opacity_decides(same, witness, is_open=True)
    assert not opacity_decides(same, witness, is_open=False)


def test_clouds_with_lids_or_with_curves_and_no_solid_are_open() -> None:
    lid = a_witness(lids=(UncoveredPatch(30.0, 30.0, np.arange(3), np.arange(1)),))
    assert lids(lid) == lid.lids
    assert lids(None) == ()
    assert is_open(rim(), lid)
    assert not is_open(rim(), a_witness())
    assert not is_open(rim(length=1000.0), a_witness())
    assert is_open(rim(length=1.0), a_witness(components=0))
    assert is_open(rim(length=1.0), None)
    assert not is_open(rim(), None)


def test_lids_that_are_most_of_the_surface_close_no_solid() -> None:
    share = limit("capped")
    n_used = a_witness().n_used
    covered = n_used * share / (1 - share)
    for factor, is_solid in ((0.99, True), (1.01, False)):
        witness = a_witness(lids=(UncoveredPatch(factor * covered, 0.0, np.arange(3), np.arange(1)),))
        assert is_mostly_seen(witness) is is_solid
        assert is_sheet(witness) is not is_solid


def test_a_mesh_overlaps_itself_beyond_the_limit() -> None:
    assert not overlaps(limit("overlap"))
    assert overlaps(limit("overlap") + 0.001)


@pytest.mark.parametrize("is_closed", [True, False])
def test_what_is_counted_is_certain(is_closed: bool) -> None:
    assert mesh_verdict(True, is_closed, exact_vertices=True) == "certain"
    assert mesh_verdict(True, is_closed, exact_vertices=False) == ("likely" if is_closed else "unsure")
    assert mesh_verdict(False, is_closed, exact_vertices=True) == "unsure"
    assert volume_verdict() == "certain"


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"is_converged": False},
        {"has_distance": False},
        {"n_unseen": 1},
        {"reaches_box": True},
        {"adds_up": False},
    ],
)
def test_a_level_set_is_likely_only_if_nothing_speaks_against_it(changes: dict[str, Any]) -> None:
    met = {"is_converged": True, "has_distance": True, "n_unseen": 0, "reaches_box": False, "adds_up": True}
    assert function_verdict(**(met | changes)) == ("unsure" if changes else "likely")


def test_all_reasons_that_decide_come_first_and_no_others() -> None:
    seen = a_witness(votes={"cut": 2, "coarse cut": 0, "shifted cut": 0, "field": 0}, quality={"crowded_wide": 1.0})
    checks = cloud_checks(seen, rim())
    failed = {check.name for check in checks if not check.passed}
    assert failed == {"confidence", "cuts", "coarse", "fields"}
    deciding, others = check_sentences(checks, seen)
    assert len(deciding) == 4
    assert all("only" in text.lower() for text in deciding)
    assert "others 0" in deciding[1]
    assert not any("only" in text.lower() for text in others)


def test_a_likely_report_stars_its_rules_alone() -> None:
    known = torus_samples(2000)
    report = tk.from_points(known.points, known.normals).report()
    assert report.verdict == "likely"
    deciding, others = report.reasons[: report.n_deciding], report.reasons[report.n_deciding :]
    for words in (
        "% of the time",
        "Delaunay cuts",
        "winding-number fields",
        "lie on the surface",
        "normals are confirmed",
    ):
        assert any(words in text for text in deciding), words
        assert not any(words in text for text in others), words
    assert report.n_deciding == 5
    assert any("opposite sheet" in text for text in others)


def test_the_seconds_of_gauss_bonnet_are_those_of_curvature_and_boundary() -> None:
    report = tk.from_points(torus_samples(1000).points).report()
    [row] = [row for row in report.evidence if row.name == "Gauss–Bonnet"]
    assert row.seconds > 0.001  # an attribute that is known already takes a microsecond


def test_a_likely_integer_says_for_which_widths_and_what_would_show_more() -> None:
    points = torus_samples(1200).points
    clean = tk.from_points(points).report()
    assert clean.resolution is not None
    first = clean.text(full=True).splitlines()[0]
    assert f"(likely, for features wider than {clean.resolution:.2g})" in first
    assert clean.advice is not None
    assert "4800" in clean.advice
    assert clean.advice not in clean.text()
    assert clean.text(full=True).endswith(clean.advice)
    noise = 0.02 * torch.randn(points.shape, generator=torch.Generator().manual_seed(0), dtype=points.dtype)
    noisy = tk.from_points(points + noise).report()
    assert noisy.resolution is not None
    assert clean.resolution < noisy.resolution < clean.resolution + 4 * 0.02
    assert any("noise hides" in reason for reason in noisy.reasons)
    half = tk.from_points(points[::2]).report()
    assert half.resolution == pytest.approx(2**0.5 * clean.resolution, rel=0.15)
