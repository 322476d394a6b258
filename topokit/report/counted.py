"""The report of a shape with a counted answer: a mesh, a volume or the level set of a function."""

from __future__ import annotations

from dataclasses import dataclass

from topokit.core.components import SurfaceComponent
from topokit.core.mesh.enclosed_solid import EnclosedSolid
from topokit.report.report import Betti, CountedAnswer, Evidence, TopologyReport
from topokit.report.verdict import overlaps


@dataclass(frozen=True)
class Details:
    """Measurements that the integer does not need.

    Attributes:
        estimate: χ⁽⁰⁾, or None if it was not computed.
        refined: χ⁽ᴷ⁾, or None if it was not computed.
        solid: what a mesh encloses by winding number, or None if it was not computed.
        evidence: rows for the report.
    """

    estimate: float | None = None
    refined: float | None = None
    solid: EnclosedSolid | None = None
    evidence: tuple[Evidence, ...] = ()


def counted_report(name: str, notes: tuple[str, ...], counted: CountedAnswer, details: Details) -> TopologyReport:
    """The report of a counted answer.

    Args:
        name: what was examined.
        notes: sentences about what was found or changed while opening it.
        counted: the answer.
        details: measurements beside it.
    """
    components, closed = counted.components, counted.closed
    genus = sum_genus(components)
    reasons = notes + counted.reasons
    if details.solid is not None and (not closed or overlaps(details.solid.off_level)):
        reasons = (*reasons, _solid_sentence(details.solid, closed))
    return TopologyReport(
        name=name,
        euler=counted.evidence.integer,
        genus=genus,
        components=len(components),
        cavities=count_cavities(components) if closed else None,
        surface_betti=(len(components), 2 * genus, len(components)) if closed and genus is not None else None,
        solid_betti=solid_betti(components) if closed else None,
        boundary_loops=counted.boundary_loops,
        closed=closed,
        verdict=counted.verdict,
        reasons=reasons,
        evidence=(counted.evidence, *counted.further, *details.evidence),
        estimate=details.estimate,
        refined=details.refined,
        solid=details.solid,
        resolution=counted.resolution,
        per_component=components,
    )


def sum_genus(components: tuple[SurfaceComponent, ...]) -> int | None:
    """Genus summed over components, or None if any is unknown."""
    genera = [component.genus for component in components if component.genus is not None]
    return sum(genera) if len(genera) == len(components) else None


def count_cavities(components: tuple[SurfaceComponent, ...]) -> int | None:
    """Number of components at odd nesting depth, or None if any depth is unknown."""
    depths = [component.depth for component in components if component.depth is not None]
    return sum(depth % 2 for depth in depths) if len(depths) == len(components) else None


def solid_betti(components: tuple[SurfaceComponent, ...]) -> Betti | None:
    """Betti numbers (components, tunnels, cavities) of the solid that closed surfaces bound, or None if unknown.

    Surfaces at even depth are outer walls of the solid, those at odd depth walls of its cavities; the tunnels of a
    solid are as many as the handles of its walls.
    """
    cavities, tunnels = count_cavities(components), sum_genus(components)
    return None if cavities is None or tunnels is None else (len(components) - cavities, tunnels, cavities)


def _solid_sentence(solid: EnclosedSolid, closed: bool) -> str:
    found = f"by winding number on a grid of step {solid.cell:.3g}, the solid it encloses has surface χ = {solid.euler}."
    if not closed:
        return f"As a solid: {found}"
    return f"{solid.off_level:.0%} of the area lies off that solid's surface: it intersects or overlaps itself; {found}"
