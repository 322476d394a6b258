"""The report of a shape that is known by its samples alone: a point cloud or Gaussian splats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import torch

from topokit.core.cloud.votes import CUT_FAMILIES, Family, values_of
from topokit.core.cloud.witness import Witness
from topokit.core.components import SurfaceComponent
from topokit.core.genus import genus_of
from topokit.core.local.gauss_bonnet import euler_by_component
from topokit.core.mesh.topology import mesh_topology
from topokit.core.neighbors import neighbor_components
from topokit.report.advice import cloud_advice
from topokit.report.cloud_wording import (
    cap_sentences,
    check_sentences,
    confidence_sentences,
    floater_sentence,
    opaque_sentence,
    open_sentences,
    outlier_sentences,
    preparation_sentences,
)
from topokit.report.examination import Examination
from topokit.report.open_surface import OpenSurface, open_surfaces
from topokit.report.report import Evidence, TopologyReport
from topokit.report.verdict import (
    OF_CLOUD,
    Check,
    Verdict,
    cloud_verdict,
    is_open,
    lasting_euler,
    lids,
    open_checks,
    with_opacity,
)
from topokit.report.wording import position

if TYPE_CHECKING:
    from topokit.core.opacity.solid import OpacityReading

_SMALLEST = 3  # sample spacings below which no feature shows in samples that bound no solid


def cloud_report(
    name: str, notes: tuple[str, ...], found: Examination, advice: str | None = None, left_out: float = 0.0
) -> TopologyReport:
    """The report of samples.

    Args:
        name: what was examined.
        notes: sentences about what was found or changed while opening it.
        found: the measurements.
        advice: what helps where these are unsure, if the representation knows better than the samples.
        left_out: width of the widest part that was taken for a floater and is not in the samples.
    """
    witness = found.witness
    is_wire = witness is not None and witness.wire is not None
    if witness is not None and found.opaque is not None:
        report = _opaque_report(found, witness, found.opaque)
    elif is_open(found.part.boundary, witness) and not is_wire:
        report = _open_report(found)
    elif witness is None:
        report = _without_solid(found)
    else:
        report = _closed_report(found, witness)
    votes = (*(vote_evidence(witness) if witness is not None else ()), *opacity_evidence(found.opacity))
    report = _with_left_out(report, left_out)
    deciding, others = report.reasons[: report.n_deciding], report.reasons[report.n_deciding :]
    estimate = Evidence("Gauss–Bonnet", found.part.estimate, None, found.part.estimate_seconds)
    return replace(
        report,
        name=name,
        reasons=(*deciding, *notes, *outlier_sentences(found.n_outliers), *others, _curvature_sentence(found)),
        evidence=(estimate, *votes),
        estimate=estimate.value,
        advice=advice or report.advice,
    )


def _with_left_out(report: TopologyReport, width: float) -> TopologyReport:
    """The report, unsure if a part as wide as its resolution was left out."""
    if not width or report.resolution is None or width < report.resolution:
        return report
    n_failed = report.n_deciding if report.verdict == "unsure" else 0
    reasons = (floater_sentence(width, report.resolution), *report.reasons)
    return replace(report, verdict="unsure", reasons=reasons, n_deciding=1 + n_failed)


def _closed_report(found: Examination, witness: Witness) -> TopologyReport:
    seen, checks = found.opacity, found.checks
    if seen is not None:
        checks = with_opacity(checks, seen, witness)
    n_surfaces = witness.components + witness.cavities
    genus = genus_of(witness.euler, components=n_surfaces) if witness.has_genus else None
    components = _solid_components(found, witness) or _cloud_components(found)
    deciding, others = check_sentences(checks, witness, seen)
    confidence = next((check.value for check in checks if check.name == "confidence"), None)
    report = _report(
        found,
        euler=witness.euler,
        verdict=cloud_verdict(checks),
        advice=cloud_advice(witness, found.samples.n_points, checks),
        reasons=(
            *deciding,
            *others,
            *confidence_sentences(witness, found.part.boundary.narrowest),
            *preparation_sentences(witness),
        ),
        n_deciding=len(deciding),
        components=components,
        n_components=n_surfaces,
        genus=genus,
        cavities=witness.cavities,
        closed=True,
        confidence=confidence,
    )
    return report if witness.wire is not None or report.verdict == "likely" else with_doubts(report, found)


def _opaque_report(found: Examination, witness: Witness, seen: OpacityReading) -> TopologyReport:
    """The report of splats of which opacity says more than samples: the solid that cannot be seen into."""
    surface = seen.surface
    assert surface is not None, "opacity decides by a surface"
    components = mesh_topology(surface.vertices, surface.faces).components
    failed, others = check_sentences(found.checks, witness)
    first = opaque_sentence(seen, witness if found.checks else None)
    report = _report(
        found,
        euler=seen.euler,
        verdict="unsure",
        advice=cloud_advice(witness, found.samples.n_points, found.checks),
        reasons=(first, *failed, *others, *preparation_sentences(witness)),
        n_deciding=1 + len(failed),
        components=components,
        n_components=len(components),
        genus=genus_of(seen.euler, components=len(components)),
        cavities=0,
        closed=True,
    )
    return replace(report, resolution=seen.resolution)


def with_doubts(report: TopologyReport, found: Examination) -> TopologyReport:
    """The report of a closed cloud with the places where it may be wrong, or a sentence that tells why there are none.

    Args:
        report: of the cloud.
        found: the measurements.
    """
    if found.doubts_refusal is None:
        return replace(report, doubts=found.doubts)
    note = f"Doubtful places were not looked for: {found.doubts_refusal}"
    return report if note in report.reasons else replace(report, reasons=(*report.reasons, note))


def _open_report(found: Examination) -> TopologyReport:
    """The surface that ends along its rims: that of a solid without the caps over its holes, or an open sheet.

    χ, components and rims are those of one surface; the genus is that with its holes closed, by caps or by discs. Where
    the union of balls has another χ for nearly all radii, that is taken, unless no such surface has these rims.
    """
    sheet, trials = found.sheet, open_surfaces(found)
    checked = [
        open_checks(one.euler, one.components, len(one.rims), sheet, found.witness, has_ring=one.has_ring)
        for one in trials
    ]
    known, checks = min(zip(trials, checked, strict=True), key=lambda trial: _rank(*trial))
    deciding, others = open_sentences(checks, sheet, known)
    if sheet is not None:
        known = known.with_euler(lasting_euler(sheet, known.euler))
    where = (*_where_open(found.part), *_where_uncovered(found))
    return _report(
        found,
        euler=known.euler,
        verdict=cloud_verdict(checks),
        advice=cloud_advice(found.witness, found.samples.n_points, checks),
        reasons=(*where, *deciding, *cap_sentences(known), *others, *_refusal(found)),
        n_deciding=len(deciding) + len(where),
        components=_cloud_components(found),
        n_components=known.components,
        genus=known.genus,
        boundary_loops=len(known.rims) or None,  # rims that cannot be traced cannot be counted
        rim_widths=known.widths,
        smallest=found.part.boundary.narrowest,
    )


def _rank(surface: OpenSurface, checks: tuple[Check, ...]) -> int:
    """How plausible a surface is, 0 for the best: its numbers are likely, or would be but for the genus, or fit it."""
    failed = [check.name for check in checks if not check.passed and check.name not in OF_CLOUD]
    if failed in ([], ["ring"]):
        return len(failed)
    return 2 if not surface.has_ring else 3 if surface.is_counted else 4


def _without_solid(found: Examination) -> TopologyReport:
    components, reasons = _cloud_components(found), _refusal(found)
    return _report(
        found,
        euler=round(found.part.estimate),
        verdict="unsure",
        advice=cloud_advice(None, found.samples.n_points),
        reasons=reasons,
        n_deciding=len(reasons),
        components=components,
        n_components=len(components),
    )


def _report(
    found: Examination,
    *,
    euler: int,
    verdict: Verdict,
    advice: str | None,
    reasons: tuple[str, ...],
    components: Sequence[SurfaceComponent],
    n_components: int,
    n_deciding: int,
    genus: int | None = None,
    cavities: int | None = None,
    boundary_loops: int | None = None,
    closed: bool = False,
    confidence: float | None = None,
    rim_widths: tuple[float, ...] = (),
    smallest: float = 0.0,
) -> TopologyReport:
    witness = found.witness
    seen = _SMALLEST * found.part.boundary.spacing if witness is None else witness.resolution
    return TopologyReport(
        name="",
        euler=euler,
        genus=genus,
        components=n_components,
        cavities=cavities,
        surface_betti=None if genus is None or not closed else (n_components, 2 * genus, n_components),
        solid_betti=None if genus is None or cavities is None else (n_components - cavities, genus, cavities),
        boundary_loops=0 if closed else boundary_loops,
        closed=closed,
        verdict=verdict,
        reasons=reasons,
        evidence=(),
        estimate=None,
        refined=None,
        solid=None,
        resolution=max(seen, smallest),
        per_component=components,
        n_deciding=n_deciding,
        confidence=confidence,
        rim_widths=rim_widths,
        advice=advice,
    )


def vote_evidence(witness: Witness) -> tuple[Evidence, ...]:
    """The families that voted, each with the value that it gives most often."""
    groups: tuple[tuple[str, tuple[Family, ...]], ...] = (
        ("Delaunay cuts", CUT_FAMILIES),
        ("winding-number fields", ("field",)),
    )
    n_values = sum(len(values_of(witness.votes, *families)) for _, families in groups)
    rows = []
    for name, families in groups:
        values = values_of(witness.votes, *families)
        if not values:
            continue  # the grids were too coarse for the samples of a large cloud
        most = max(values, key=lambda value: (values.count(value), -abs(value)))
        seconds = witness.seconds["votes"] * len(values) / n_values
        rows.append(Evidence(name, sum(values) / len(values), most, seconds))
    wire = witness.wire
    if wire is not None:
        rows.append(Evidence("union of balls", float(wire.euler), wire.euler, wire.seconds))
    return tuple(rows)


def opacity_evidence(seen: OpacityReading | None) -> tuple[Evidence, ...]:
    """The integer of what cannot be seen into, if that was looked for."""
    if seen is None:
        return ()
    return (Evidence("opacity from outside", sum(seen.eulers) / len(seen.eulers), seen.euler, seen.seconds),)


def _cloud_components(found: Examination) -> tuple[SurfaceComponent, ...]:
    """Connected components of the neighbor graph with their Gauss–Bonnet estimates, largest area first."""
    points, local = found.part.samples.points, found.part.curvature
    labels = neighbor_components(found.part.neighbors)
    estimates = euler_by_component(local.gaussian, local.area, labels)
    areas = torch.zeros_like(estimates).index_add(0, labels, local.area)
    shares = (areas / areas.sum().clamp(min=torch.finfo(areas.dtype).tiny)).tolist()
    rows = labels[:, None].expand_as(points)
    corners = points.new_zeros(len(estimates), 3)
    low = corners.scatter_reduce(0, rows, points, "amin", include_self=False).tolist()
    high = corners.scatter_reduce(0, rows, points, "amax", include_self=False).tolist()
    components = [
        SurfaceComponent(None, None, None, (tuple(low[i]), tuple(high[i])), shares[i], estimate=estimate)
        for i, estimate in enumerate(estimates.tolist())
    ]
    return tuple(sorted(components, key=lambda component: -component.area_share))


def _solid_components(found: Examination, witness: Witness) -> Sequence[SurfaceComponent]:
    """Components of the first cut's surface, counted as a mesh; empty if they do not add up to the answer."""
    if found.surface is None:
        return ()
    topology = mesh_topology(found.surface.vertices, found.surface.faces)
    same = topology.is_closed and topology.euler == witness.euler
    same = same and len(topology.components) == witness.components + witness.cavities
    return topology.components if same else ()


def _refusal(found: Examination) -> tuple[str, ...]:
    return () if found.refusal is None else (f"No solid can be found from these points: {found.refusal}",)


def _curvature_sentence(found: Examination) -> str:
    share = f", {found.part.boundary.euler:.2f} of it from the boundary" if found.part.boundary.curves else ""
    return f"The curvature of {found.part.samples.n_points} samples sums to χ ≈ {found.part.estimate:.2f}{share}."


def _where_open(found: Examination) -> tuple[str, ...]:
    points, local, boundary = found.samples.points, found.curvature, found.boundary
    if not boundary.curves:
        return ()
    index = torch.cat([curve.index for curve in boundary.curves]).to(points.device)
    low, high = points[index].aminmax(dim=0)
    extent = float((points.amax(0) - points.amin(0)).max())
    corners = (position(corner.tolist(), extent) for corner in (low, high))
    band = min(1.0, boundary.length * float(local.area.mean().sqrt()) / float(local.area.sum()))
    return (
        f"The surface is not closed: the samples end along a total length of {boundary.length:.4g}, between "
        f"{' and '.join(corners)}; {band:.1%} of the area lies within a sample spacing of their end.",
    )


def _where_uncovered(found: Examination) -> tuple[str, ...]:
    points, witness = found.samples.points, found.witness
    if witness is None or not (covers := lids(witness)):
        return ()
    low, high = points[torch.from_numpy(covers[0].samples).to(points.device)].aminmax(dim=0)
    extent = float((points.amax(0) - points.amin(0)).max())
    corners = " and ".join(position(corner.tolist(), extent) for corner in (low, high))
    width = float((high - low).max()) / witness.spacing
    return (
        f"The surface is not closed: the largest patch without samples is {width:.0f} sample spacings wide and lies "
        f"between {corners}, where about {covers[0].missing:.0f} samples are missing.",
    )
