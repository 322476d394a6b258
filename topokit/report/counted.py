"""The report of a shape with a counted answer: a mesh, a volume or the level set of a function."""

from __future__ import annotations

from topokit.report.report import CountedAnswer, TopologyReport


def counted_report(name: str, notes: tuple[str, ...], counted: CountedAnswer) -> TopologyReport:
    """The report of a counted answer.

    Args:
        name: what was examined.
        notes: sentences about what was found or changed while opening it.
        counted: the answer.
    """
    components, closed = counted.components, counted.closed
    deciding, others = counted.reasons[: counted.n_deciding], counted.reasons[counted.n_deciding :]
    genus = components.genus
    return TopologyReport(
        name=name,
        euler=counted.evidence.integer,
        genus=genus,
        components=len(components),
        cavities=components.cavities if closed else None,
        surface_betti=(len(components), 2 * genus, len(components)) if closed and genus is not None else None,
        solid_betti=components.solid_betti if closed else None,
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
        confidence=1.0 if counted.verdict == "certain" else None,
    )
