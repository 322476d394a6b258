"""The closed surface behind a report: triangles whose V − E + F is the reported integer, or why there are none."""

from __future__ import annotations

from topokit.core.mesh.topology import mesh_topology
from topokit.core.surface import TriangleSurface
from topokit.errors import InputError
from topokit.report.report import TopologyReport, why
from topokit.report.wording import plural


def checked_surface(report: TopologyReport, surface: TriangleSurface | None) -> TriangleSurface:
    """The surface that a report is about, facing outward.

    Args:
        report: of a shape.
        surface: what was found for it, or None.

    Raises:
        InputError: if there is none, or it is open, not a manifold or does not count to the report's integer.
    """
    if surface is None or len(surface.faces) == 0 or not report.closed:
        ends = f"It ends along {plural(report.boundary_loops, 'boundary loop')}. " if report.boundary_loops else ""
        raise InputError(f"{report.name} has no closed surface. {ends}{why(report)}")
    topology = mesh_topology(surface.vertices, surface.faces)
    if not topology.is_closed or topology.euler != report.euler:
        found = f"counts to χ = {topology.euler}" if topology.is_closed else "is not a closed manifold"
        raise InputError(
            f"{report.name}: the surface that was found {found}, but χ = {report.euler} ({report.verdict}) is "
            f"reported, so it is not given. {why(report)}"
        )
    return TriangleSurface(surface.vertices, topology.faces)
