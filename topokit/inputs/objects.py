"""Points and triangles of objects of other libraries, by their attributes; none of the libraries is imported."""

from __future__ import annotations

from typing import Any

import numpy as np


def points_of(source: Any) -> tuple[Any, Any | None] | None:
    """Positions and normals of an object that holds points.

    Args:
        source: a point cloud of open3d (either API) or trimesh; a mesh of either, for its vertices alone; or a
            `trimesh.Scene` of these, concatenated with their transformations applied.

    Returns:
        Positions (N, 3) and normals (N, 3) or None, as arrays of whatever kind the object has; None for other objects.
    """
    if _is_scene(source):
        parts = [part.vertices for part in source.dump()]
        return (np.concatenate(parts), None) if parts else None
    attributes: Any
    for attributes in (getattr(source, "point", None), getattr(source, "vertex", None)):  # open3d's tensor API
        if _has(attributes, "positions"):
            is_cloud = hasattr(source, "point") and "normals" in attributes
            return attributes["positions"], attributes["normals"] if is_cloud else None
    if hasattr(source, "points") and hasattr(source, "has_normals"):  # open3d's legacy API
        return source.points, source.normals if source.has_normals() else None
    return (source.vertices, None) if hasattr(source, "vertices") else None


def triangles_of(source: Any) -> tuple[Any, Any] | None:
    """Vertices and faces of an object that holds triangles.

    Args:
        source: a mesh of open3d (either API), a `trimesh.Trimesh`, a `trimesh.Scene`, which is flattened with its
            transformations, or anything else with `vertices` and `faces`.

    Returns:
        Vertices (V, 3) and faces (F, 3), as arrays of whatever kind the object has; None for other objects.
    """
    source = source.to_mesh() if _is_scene(source) else source
    vertex: Any = getattr(source, "vertex", None)  # open3d's tensor API
    triangle: Any = getattr(source, "triangle", None)
    if _has(vertex, "positions") and _has(triangle, "indices"):
        return vertex["positions"], triangle["indices"]
    for faces in ("faces", "triangles"):
        if hasattr(source, "vertices") and hasattr(source, faces):
            return source.vertices, getattr(source, faces)
    return None


def _is_scene(source: object) -> bool:
    return hasattr(source, "dump") and hasattr(source, "to_mesh")


def _has(attributes: Any, name: str) -> bool:
    """Whether this is a mapping, such as open3d's TensorMap, with this entry."""
    return hasattr(attributes, "__contains__") and hasattr(attributes, "__getitem__") and name in attributes
