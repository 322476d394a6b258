"""The answer of a triangle mesh: V − E + F, and why the mesh is not closed where it is not."""

from __future__ import annotations

import numpy as np

from topokit.core.mesh.topology import MeshTopology
from topokit.report.counted import CountedAnswer
from topokit.report.report import Evidence
from topokit.report.verdict import Verdict, mesh_verdict
from topokit.report.wording import plural, position


def mesh_answer(topology: MeshTopology, seconds: float, *, exact_vertices: bool = True) -> CountedAnswer:
    """The counted answer of a mesh.

    Args:
        topology: what counting found.
        seconds: time it took.
        exact_vertices: whether it is beyond doubt which vertices are one, see `CountedMesh`.
    """
    verdict = mesh_verdict(topology.is_manifold, topology.is_closed, exact_vertices)
    deciding = _deciding(topology, verdict)
    return CountedAnswer(
        evidence=Evidence("V − E + F", float(topology.euler), topology.euler, seconds),
        components=topology.components,
        closed=topology.is_closed,
        boundary_loops=topology.boundary_loops,
        verdict=verdict,
        reasons=(*deciding, *_further(topology)),
        manifold=topology.is_manifold,
        n_deciding=len(deciding),
        flipped=topology.flipped_faces,
        inverted=int(topology.inverted.sum()),
        advice=_advice(topology, verdict),
    )


HOW_TO_SPLIT = (
    "MeshLab's filter Repair non Manifold Edges (by splitting vertices) separates bodies that touch along an edge."
)


def _advice(topology: MeshTopology, verdict: Verdict) -> str | None:
    if not topology.is_manifold:
        where = "shape.defects(), or topokit report --locate, says where the faults are"
        return f"{where}. {HOW_TO_SPLIT}" if topology.nonmanifold_edges else f"{where}."
    if topology.is_closed:
        return None
    if verdict == "unsure":
        return "Merge the vertices that are one; topokit report --tolerances shows what that would change."
    return "shape.fill_boundaries(), or topokit mend --boundaries, closes the mesh."


def _deciding(topology: MeshTopology, verdict: Verdict) -> tuple[str, ...]:
    parts = plural(len(topology.components), "component")
    if topology.is_closed:
        return (
            f"Every edge has two faces and every vertex one fan: V − E + F = {topology.euler} over {parts} is exact.",
        )
    if topology.is_manifold:
        if verdict == "certain":
            return (
                f"Every edge has one or two faces and every vertex one fan: V − E + F = {topology.euler} over {parts} "
                "is exact.",
            )
        return (
            f"Vertices on the boundary coincide, and it is unknown whether they are one: V − E + F as it stands is "
            f"{topology.euler} over {parts}.",
        )
    lines = [f"The mesh is not a manifold; its V − E + F as it stands is {topology.euler} over {parts}."]
    if topology.nonmanifold_edges:
        lines.append(f"{plural(topology.nonmanifold_edges, 'edge')} with three or more faces (non-manifold).")
    if topology.pinched_vertices:
        lines.append(
            f"{plural(topology.pinched_vertices, 'vertex', 'vertices')} where separate fans of faces touch (pinched)."
        )
    return tuple(lines)


def _further(topology: MeshTopology) -> tuple[str, ...]:
    lines = []
    if topology.boundary_edges:
        loops = plural(topology.boundary_loops, "boundary loop")
        lines.append(f"It is open: {plural(topology.boundary_edges, 'edge')} in {loops} have only one face.")
    if topology.flipped_faces:
        lines.append(
            f"{plural(topology.flipped_faces, 'face')} turned against the others (flipped); V − E + F is unaffected."
        )
    lines += _inside_out(topology)
    if not topology.is_orientable:
        lines.append("The surface is one-sided (not orientable), so it has no genus in the usual sense.")
    return tuple(lines)


def _inside_out(topology: MeshTopology) -> list[str]:
    """Which components point inward without bounding a cavity, and which bound one and point out of it."""
    lines, (inverted,) = [], np.nonzero(topology.inverted)
    if len(inverted):
        low, high = topology.components.low[inverted[0]], topology.components.high[inverted[0]]
        where = position(((low + high) / 2).tolist(), float((high - low).max()))
        lines.append(
            f"{plural(len(inverted), 'closed component')} facing inward without bounding a cavity (inverted), "
            f"{'the largest ' if len(inverted) > 1 else ''}around {where}; turned for the normals."
        )
    if n_cavities := topology.inward_components - len(inverted):
        lines.append(f"{plural(n_cavities, 'cavity', 'cavities')} facing into the solid, turned for the normals.")
    return lines
