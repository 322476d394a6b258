"""The answer of a triangle mesh: V − E + F, and why the mesh is not closed where it is not."""

from __future__ import annotations

from topokit.core.mesh.topology import MeshTopology
from topokit.report.report import CountedAnswer, Evidence
from topokit.report.verdict import mesh_verdict
from topokit.report.wording import plural


def mesh_answer(topology: MeshTopology, seconds: float, *, exact_vertices: bool = True) -> CountedAnswer:
    """The counted answer of a mesh.

    Args:
        topology: what counting found.
        seconds: time it took.
        exact_vertices: False if the mesh is closed only after vertices that nearly coincide were merged.
    """
    return CountedAnswer(
        evidence=Evidence("V − E + F", float(topology.euler), topology.euler, seconds),
        components=topology.components,
        closed=topology.is_closed,
        boundary_loops=topology.boundary_loops,
        verdict=mesh_verdict(topology.is_closed, exact_vertices),
        reasons=_reasons(topology),
        manifold=topology.is_manifold,
        n_deciding=1 + sum(map(bool, _faults(topology))),
    )


def _faults(topology: MeshTopology) -> tuple[int, int, int]:
    """The numbers of what keeps a mesh from being a closed manifold."""
    return topology.boundary_edges, topology.nonmanifold_edges, topology.pinched_vertices


def _reasons(topology: MeshTopology) -> tuple[str, ...]:
    parts = plural(len(topology.components), "component")
    if topology.is_closed:
        lines = [
            f"Every edge has two faces and every vertex one fan: V − E + F = {topology.euler} over {parts} is exact."
        ]
    else:
        lines = [f"The mesh is not a closed manifold; its V − E + F as it stands is {topology.euler} over {parts}."]
    if topology.boundary_edges:
        loops = plural(topology.boundary_loops, "boundary loop")
        lines.append(f"It is open: {plural(topology.boundary_edges, 'edge')} in {loops} have only one face.")
    if topology.nonmanifold_edges:
        lines.append(f"{plural(topology.nonmanifold_edges, 'edge')} with three or more faces (non-manifold).")
    if topology.pinched_vertices:
        lines.append(
            f"{plural(topology.pinched_vertices, 'vertex', 'vertices')} where separate fans of faces touch (pinched)."
        )
    if topology.flipped_faces:
        lines.append(
            f"{plural(topology.flipped_faces, 'face')} turned against the others (flipped); V − E + F is unaffected."
        )
    if topology.inward_components:
        lines.append(f"{plural(topology.inward_components, 'closed component')} facing inward, turned for the normals.")
    if not topology.is_orientable:
        lines.append("The surface is one-sided (not orientable), so it has no genus in the usual sense.")
    return tuple(lines)
