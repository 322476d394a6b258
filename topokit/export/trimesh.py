"""Shapes as meshes of trimesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

from topokit.core.surface import TriangleSurface
from topokit.errors import InputError
from topokit.export.colors import Quantity, colored_surface

if TYPE_CHECKING:
    import trimesh

    from topokit.shape import Shape


def as_trimesh(surface: TriangleSurface) -> trimesh.Trimesh:
    """Triangles as a `trimesh.Trimesh`; nothing is merged."""
    import trimesh

    return trimesh.Trimesh(surface.vertices, surface.faces, process=False)


def to_trimesh(shape: Shape, color_by: Quantity | None = "gaussian") -> trimesh.Trimesh:
    """The mesh of a shape as a `trimesh.Trimesh`, with curvature as vertex colors and attributes.

    Vertices and faces are those that the shape was counted from; nothing is merged or removed. Each vertex has the
    curvature of the samples around it, under the names gaussian, mean, total, k_min, k_max and area in
    `vertex_attributes`. Gradients end here.

    Args:
        shape: a shape that was made from a mesh.
        color_by: "gaussian", "mean" or "total": the curvature shown as colors, see `topokit.export.colors`; None for
            the bare mesh, without computing curvature.

    Raises:
        InputError: if the shape was not made from a mesh, `color_by` is not one of the three, or the samples are
            batched.
    """
    if shape.mesh is None:
        raise InputError(
            f"{shape.name} was not made from a mesh, so there is none to export; save_ply and to_open3d take any shape."
        )
    import trimesh

    if color_by is None:
        vertices, faces = (part.detach().cpu().numpy() for part in shape.mesh)
        return trimesh.Trimesh(vertices, faces, process=False)
    surface = colored_surface(shape, color_by)
    return trimesh.Trimesh(
        surface.positions,
        surface.faces,
        vertex_colors=surface.colors,
        vertex_attributes=surface.fields,
        process=False,
    )
