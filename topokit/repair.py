"""Repair of meshes where it is exact: small handles removed, boundary loops filled, and the result counted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from topokit.adapters.mesh.adapter import from_mesh
from topokit.shape import Shape

if TYPE_CHECKING:
    import trimesh


def simplify_topology(mesh: Any, *, below: float) -> trimesh.Trimesh:
    """A closed mesh without its small handles and tunnels, which in scans and generated meshes are mostly noise.

    The shorter of the two loops of a handle is its size and decides how it is removed: a handle loop is cut through, a
    tunnel loop is closed by a wall. Vertices away from these loops keep their places and their order. χ rises by two
    for each, which is counted before the mesh is returned.

    Args:
        mesh: whatever `from_mesh` takes as its first argument, or a `Shape` with a closed surface.
        below: length of the shorter loop, in units of the vertices; what is as long or longer stays.

    Raises:
        InputError: if the mesh is open or not a manifold (`fill_boundaries` closes holes), intersects itself, or is too
            coarse to be cut along a loop; or if `below` is not a positive number.

    Example:
        >>> import topokit as tk
        >>> from topokit.testing import torus_mesh
        >>> tk.simplify_topology(torus_mesh(major=1, minor=0.1), below=1).euler_number
        2
    """
    return (mesh if isinstance(mesh, Shape) else from_mesh(mesh)).simplify_topology(below=below)


def fill_boundaries(mesh: Any) -> trimesh.Trimesh:
    """A mesh with every boundary loop closed by a fan of triangles.

    Vertices keep their places and their order; a vertex at which two boundary loops touch is doubled. What is filled is
    a closed manifold, which is counted before it is returned. Fans suit small holes: over a large and bent boundary
    they can pass through the surface.

    Args:
        mesh: whatever `from_mesh` takes as its first argument, or a `Shape` that was made from a mesh.

    Raises:
        InputError: if the mesh has edges with three faces or more or cannot be oriented, or the shape has no mesh.
    """
    return (mesh if isinstance(mesh, Shape) else from_mesh(mesh)).fill_boundaries()
