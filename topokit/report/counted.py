"""The report of a shape with a counted answer: a mesh, a volume or the level set of a function."""

from __future__ import annotations

from topokit.core.components import SurfaceComponent
from topokit.report.report import Betti, CountedAnswer, TopologyReport


def counted_report(name: str, notes: tuple[str, ...], counted: CountedAnswer) -> TopologyReport:
    """The report of a counted answer.

    Args:
        name: what was examined.
        notes: sentences about what was found or changed while opening it.
        counted: the answer.
    """
    components, closed = counted.components, counted.closed
    genus = sum_genus(components)
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
        reasons=notes + counted.reasons,
        evidence=(counted.evidence, *counted.further),
        estimate=None,
        refined=None,
        solid=None,
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
