"""From evidence to report: what the witnesses said, put together for one shape."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from topokit.core.cloud.witness import Witness
from topokit.core.components import SurfaceComponent
from topokit.core.local.boundary import BoundaryCurve, BoundaryEstimate
from topokit.core.local.curvature import Curvature
from topokit.core.local.gauss_bonnet import euler_by_component
from topokit.core.mesh.enclosed_solid import EnclosedSolid
from topokit.core.mesh.topology import mesh_topology
from topokit.core.neighbors import neighbor_components
from topokit.report.report import (
    CountedAnswer,
    Evidence,
    TopologyReport,
    betti_numbers,
    count_cavities,
    sum_genus,
)
from topokit.report.verdict import Verdict
from topokit.report.witnesses import is_sheet

_OVERLAP = 0.04  # share of a closed mesh's area off its own solid from which it is said to overlap itself
_GAPS = 0.05  # share of samples with neighbours on one side only that closed surfaces do not reach


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured on the samples of one shape.

    Attributes:
        local: curvatures of the samples as they are.
        ends: where the surface ends.
        estimate: χ⁽⁰⁾ with the boundary's term.
        refined: χ⁽ᴷ⁾ with the boundary's term, or None.
        witness: the global witness, or None where it refused; then `refusal` says why.
        refusal: its sentence, or "".
        evidence: for the report.
        solid: what a mesh encloses by winding number, or None where there is no mesh.
    """

    local: Curvature
    ends: BoundaryEstimate
    estimate: float
    refined: float | None
    witness: Witness | None
    refusal: str
    evidence: tuple[Evidence, ...]
    solid: EnclosedSolid | None = None


def exact_report(name: str, notes: tuple[str, ...], exact: CountedAnswer, measured: Measured) -> TopologyReport:
    """The report of a shape that carries a combinatorial answer."""
    closed, components = exact.closed, exact.components
    reasons = notes + exact.reasons
    if measured.solid is not None and (not closed or measured.solid.off_level > _OVERLAP):
        reasons = (*reasons, _solid_sentence(measured.solid, closed))
    return TopologyReport(
        name=name,
        euler=exact.evidence.integer,
        genus=sum_genus(components),
        components=len(components),
        cavities=count_cavities(components) if closed else None,
        betti=betti_numbers(components, closed),
        boundary_loops=exact.boundary_loops,
        closed=closed,
        verdict=exact.verdict,
        reasons=reasons,
        evidence=(exact.evidence, *exact.further, *measured.evidence),
        estimate=measured.estimate,
        refined=measured.refined,
        resolution=exact.resolution,
        per_component=components,
    )


def sampled_report(name: str, notes: tuple[str, ...], points: Tensor, measured: Measured) -> TopologyReport:
    """The report of a shape that is known by its samples alone."""
    witness, local, curves = measured.witness, measured.local, measured.ends.curves
    spacing = float(local.area.mean().sqrt())
    closed = witness is not None and not curves
    components = cloud_components(points, local)
    verdict: Verdict = "unsure"
    reasons: tuple[str, ...]
    integer: int | None
    genus, cavities = None, None
    if witness is None:
        integer = round(measured.estimate)
        reasons = (f"No solid can be found from these points: {measured.refusal}",)
    elif closed:
        integer, verdict = witness.euler, witness.verdict
        surfaces = solid_components(points, witness)
        n_surfaces = witness.components + witness.cavities
        genus = (2 * n_surfaces - integer) // 2
        if genus < 0:
            genus, verdict = None, "unsure"
        components = surfaces or components
        cavities = witness.cavities
        reasons = witness.reasons
        if measured.ends.rim_share > _GAPS:
            verdict = "unsure"
            reasons = (
                f"{measured.ends.rim_share:.0%} of the samples have neighbours on one side only: they lie along lines "
                "or around gaps, and what is between them is not known.",
                *reasons,
            )
    else:
        integer = round(measured.estimate) if is_sheet(measured.ends, witness) else witness.euler
        reasons = ()
    if curves:
        reasons = (_where_open(points, local, curves, spacing), *reasons)
    n_components = len(components) if witness is None or not closed else witness.components + witness.cavities
    return TopologyReport(
        name=name,
        euler=integer,
        genus=genus,
        components=n_components,
        cavities=cavities,
        betti=(n_components, 2 * genus, n_components) if genus is not None else None,
        boundary_loops=0 if closed else len(curves) or None,
        closed=closed,
        verdict=verdict,
        reasons=(*notes, _curvature_sentence(measured, len(points)), *reasons),
        evidence=measured.evidence,
        estimate=measured.estimate,
        refined=measured.refined,
        resolution=witness.resolution if witness is not None else 3 * spacing,
        per_component=components,
    )


def cloud_components(points: Tensor, local: Curvature) -> tuple[SurfaceComponent, ...]:
    """Components of the neighbour graph with their estimates, largest area first."""
    labels = neighbor_components(local.neighbors)
    estimates = euler_by_component(local.gaussian, local.area, labels)
    areas = torch.zeros_like(estimates).index_add(0, labels, local.area)
    shares = (areas / areas.sum().clamp(min=torch.finfo(areas.dtype).tiny)).tolist()
    rows = labels[:, None].expand_as(points)
    corners = points.new_zeros(len(estimates), 3)
    low = corners.scatter_reduce(0, rows, points, "amin", include_self=False).tolist()
    high = corners.scatter_reduce(0, rows, points, "amax", include_self=False).tolist()
    found = [
        SurfaceComponent(None, None, None, (tuple(low[i]), tuple(high[i])), shares[i], estimate=estimate)
        for i, estimate in enumerate(estimates.tolist())
    ]
    return tuple(sorted(found, key=lambda component: -component.area_share))


def solid_components(points: Tensor, witness: Witness) -> tuple[SurfaceComponent, ...]:
    """Components of the surface that the first cut implies, counted like a mesh; empty if that is not the answer."""
    if len(witness.faces) == 0:
        return ()
    vertices: NDArray[np.float64] = points.detach().cpu().double().numpy()
    topology = mesh_topology(vertices, witness.faces)
    same = topology.is_closed and topology.euler == witness.euler
    same = same and len(topology.components) == witness.components + witness.cavities
    return tuple(replace(component, boundary_loops=0) for component in topology.components) if same else ()


def _curvature_sentence(measured: Measured, n_points: int) -> str:
    boundary = measured.ends.euler
    share = f", {boundary:.2f} of it from the boundary's turning" if measured.ends.curves else ""
    return f"Curvature over {n_points} samples sums to χ ≈ {measured.estimate:.2f}{share}."


def _solid_sentence(solid: EnclosedSolid, closed: bool) -> str:
    found = (
        f"by winding number at steps of {solid.cell:.3g} the solid it encloses has a surface with χ = {solid.euler}."
    )
    if not closed:
        return f"As a solid: {found}"
    share = f"{solid.off_level:.0%} of the area does not bound the mesh's own solid"
    return f"{share}: it intersects or overlaps itself; {found}"


def _where_open(points: Tensor, local: Curvature, curves: tuple[BoundaryCurve, ...], spacing: float) -> str:
    index = torch.cat([curve.index for curve in curves]).to(points.device)
    low, high = (", ".join(f"{value:.4g}" for value in corner.tolist()) for corner in points[index].aminmax(dim=0))
    length = sum(curve.length for curve in curves)
    band = min(1.0, length * spacing / float(local.area.sum()))
    many = "curve" if len(curves) == 1 else "curves"
    return (
        f"The surface is not closed: its boundary runs along {len(curves)} {many} of length {length:.4g} in all, "
        f"between ({low}) and ({high}); {band:.1%} of the area lies within a sample spacing of it."
    )
