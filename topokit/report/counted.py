"""Answers that were counted or proven, and the report of one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from topokit.core.components import CountedComponents
from topokit.core.grid.minkowski import MinkowskiNumbers
from topokit.core.grid.placement import Placement
from topokit.report.confidence import counted_confidence
from topokit.report.report import Evidence, TopologyReport
from topokit.report.verdict import Verdict

if TYPE_CHECKING:
    from topokit.core.blocks.periodic import PeriodicSolid


@dataclass(frozen=True)
class CountedAnswer:
    """An integer found by counting cells, as an adapter provides it.

    Attributes:
        evidence: the count.
        components: the surface's connected components, largest area first.
        closed: whether the surface is a closed manifold.
        boundary_loops: number of boundary loops, or None if they were not counted. Where a mesh is no manifold, they
            are those of its faces once pinched vertices are taken apart.
        verdict: how far the answer may be believed.
        reasons: sentences with their numbers.
        resolution: width of the narrowest feature that the count can see, in units of length; None if it is exact.
        further: additional evidence.
        n_deciding: how many of the first reasons decided the verdict.
        manifold: whether no edge has three faces and no vertex two fans, or None if that is unknown.
        placement: of the voxels of a volume, else None.
        cut_out_euler: as for `TopologyReport`.
        connectivity_density: likewise.
        torus: of a volume that is periodic, what its components do not tell.
        minkowski: as for `TopologyReport`, where the count has them.
        flipped, inverted, advice: as for `TopologyReport`.
    """

    evidence: Evidence
    components: CountedComponents
    closed: bool
    boundary_loops: int | None
    verdict: Verdict
    reasons: tuple[str, ...]
    resolution: float | None = None
    further: tuple[Evidence, ...] = ()
    n_deciding: int = 1
    manifold: bool | None = None
    placement: Placement | None = None
    cut_out_euler: float | None = None
    connectivity_density: float | None = None
    torus: PeriodicSolid | None = None
    minkowski: MinkowskiNumbers | None = None
    flipped: int | None = None
    inverted: int | None = None
    advice: str | None = None


def counted_report(name: str, notes: tuple[str, ...], counted: CountedAnswer) -> TopologyReport:
    """The report of a counted answer.

    Args:
        name: what was examined.
        notes: sentences about what was found or changed while opening it.
        counted: the answer.
    """
    components, closed, torus = counted.components, counted.closed, counted.torus
    n_components, solid = len(components), components.solid_betti if closed else None
    deciding, others = counted.reasons[: counted.n_deciding], counted.reasons[counted.n_deciding :]
    genus = components.genus
    if torus is not None:
        n_components, solid, genus = torus.n_surfaces, torus.betti, torus.genus
    return TopologyReport(
        name=name,
        euler=counted.evidence.integer,
        genus=genus,
        components=n_components,
        cavities=(components.cavities if torus is None else torus.betti[2]) if closed else None,
        surface_betti=(n_components, 2 * genus, n_components) if closed and genus is not None else None,
        solid_betti=solid,
        boundary_loops=counted.boundary_loops,
        closed=closed,
        verdict=counted.verdict,
        reasons=deciding + notes + others,
        evidence=(counted.evidence, *counted.further),
        estimate=None,
        refined=None,
        solid=None,
        resolution=counted.resolution,
        per_component=components,
        n_deciding=len(deciding),
        confidence=counted_confidence(counted.verdict),
        placement=counted.placement,
        cut_out_euler=counted.cut_out_euler,
        connectivity_density=counted.connectivity_density,
        minkowski=counted.minkowski,
        flipped=counted.flipped,
        inverted=counted.inverted,
        advice=counted.advice,
    )
