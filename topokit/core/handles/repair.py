"""Meshes without boundary, counted before they are returned."""

from __future__ import annotations

from topokit.core.arrays import Floats
from topokit.core.handles.surgery import Arrays, filled
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
        raise InputError(f"the mesh has {fault}, so its boundary cannot be filled: defects() says where.")
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
