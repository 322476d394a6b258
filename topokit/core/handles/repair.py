"""Meshes with fewer handles or no boundary, counted before they are returned."""

from __future__ import annotations

from topokit.core.arrays import Floats, Integers
from topokit.core.handles.find import find_handles
from topokit.core.handles.handle import Handle
from topokit.core.handles.surgery import Arrays, filled, without_loops
from topokit.core.labels import count_distinct
from topokit.core.mesh.connectivity import mesh_connectivity
from topokit.core.mesh.topology import MeshTopology, mesh_topology
from topokit.errors import InputError


def without_boundary(vertices: Floats, topology: MeshTopology) -> Arrays:
    """A mesh with every boundary loop closed by a disc, which raises χ by one each.

    Args:
        vertices: (V, 3).
        topology: of the mesh.

    Raises:
        InputError: if the mesh has edges with three faces or more, is not orientable, or does not count to what it
            should when its boundary is closed.
    """
    if topology.nonmanifold_edges or not topology.is_orientable:
        fault = "edges with three faces or more" if topology.nonmanifold_edges else "no consistent orientation"
        raise InputError(f"the mesh has {fault}, so its boundary cannot be filled: repair it first.")
    points, triangles = filled(vertices, topology.faces)
    n_doubled = int(mesh_connectivity(topology.faces).fans.max()) + 1 - count_distinct(topology.faces.ravel())
    euler = topology.euler + n_doubled + topology.boundary_loops
    after = mesh_topology(points, triangles)
    if not after.is_closed or after.flipped_faces or after.euler != euler:
        raise InputError(
            f"the mesh cannot be closed by filling its boundary: χ = {euler} was expected, and the result counts to "
            f"{after.euler}. Repair it first."
        )
    return points, triangles


def simplified(vertices: Floats, faces: Integers, below: float) -> Arrays:
    """A closed mesh without the handles that are smaller than a length.

    The shorter loop of a handle decides: one that bounds inside is cut, one that bounds outside is filled. What is left
    is measured anew until nothing smaller remains, since removing one handle can change the loops of its neighbors.

    Args:
        vertices: (V, 3).
        faces: (F, 3), closed, manifold and consistently oriented.
        below: length of the shorter loop, in units of the vertices.

    Raises:
        InputError: if the mesh is not closed, intersects itself, or is too coarse to be cut along a loop.
    """
    while True:
        small = [handle for handle in find_handles(vertices, mesh_topology(vertices, faces)) if handle.size < below]
        if not small:
            return vertices, faces
        vertices, faces = without_loops(vertices, faces, _apart(small))


def _apart(handles: list[Handle]) -> list[Integers]:
    """The shorter loops of as many handles as do not meet each other, the shortest first.

    There is at most one of every handle, so they are part of a basis and do not separate the surface.
    """
    taken: set[int] = set()
    chosen: list[Integers] = []
    for handle in handles:
        own = set(handle.shorter.tolist())
        if len(own) == len(handle.shorter) and taken.isdisjoint(own):
            chosen.append(handle.shorter)
            taken |= own
    return chosen or [handles[0].shorter]
