"""Points and triangles of objects of other libraries, by their attributes; none of the libraries is imported."""

from __future__ import annotations

from typing import Any

import numpy as np

from topokit.errors import InputError
from topokit.inputs.cells import padded_polygons, polygons_of_cells, polygons_of_list

_COORDINATES, _NORMALS = ("x", "y", "z"), ("nx", "ny", "nz")


def points_of(source: Any) -> tuple[Any, Any | None] | None:
    """Positions and normals of an object that holds points.

    Args:
        source: a point cloud of open3d (either API), trimesh, PyVista, vedo or PyTorch3D; a data frame with columns
            x, y, z and perhaps nx, ny, nz (in any case), or with three columns of other names; a mesh of these
            libraries, for its vertices alone; or a `trimesh.Scene` of these, concatenated with their transformations
            applied.

    Returns:
        Positions (N, 3) and normals (N, 3) or None, as arrays of whatever kind the object has; None for other objects.

    Raises:
        InputError: if it holds several clouds, or a data frame has other columns.
    """
    if _is_scene(source):
        parts = [part.vertices for part in source.dump()]
        return (np.concatenate(parts), None) if parts else None
    if is_frame(source):
        return _columns(source)
    attributes: Any
    for attributes in (getattr(source, "point", None), getattr(source, "vertex", None)):  # open3d's tensor API
        if _has(attributes, "positions"):
            is_cloud = hasattr(source, "point") and "normals" in attributes
            return attributes["positions"], attributes["normals"] if is_cloud else None
    if hasattr(source, "points_list") and hasattr(source, "normals_list"):  # PyTorch3D
        normals = source.normals_list()
        return _only(source.points_list(), "clouds"), None if normals is None else _only(normals, "clouds")
    if hasattr(source, "points") and hasattr(source, "has_normals"):  # open3d's legacy API
        return source.points, source.normals if source.has_normals() else None
    if hasattr(source, "points") and hasattr(source, "point_data"):  # PyVista and meshio
        return source.points, source.point_data.get("Normals")
    return (source.vertices, None) if hasattr(source, "vertices") else None


def triangles_of(source: Any) -> tuple[Any, Any] | None:
    """Vertices and faces of an object that holds polygons.

    Args:
        source: a mesh of open3d (either API), trimesh (a scene is flattened with its transformations), PyTorch3D,
            Kaolin, PyVista, vedo or meshio (of solid cells their surface), or anything else with `vertices` and
            `faces`.

    Returns:
        Vertices (V, 3) and faces (F, n), as arrays of whatever kind the object has; None for other objects.

    Raises:
        InputError: if it holds several meshes, or cells of an unknown type.
    """
    source = source.to_mesh() if _is_scene(source) else source
    vertex: Any = getattr(source, "vertex", None)  # open3d's tensor API
    triangle: Any = getattr(source, "triangle", None)
    if _has(vertex, "positions") and _has(triangle, "indices"):
        return vertex["positions"], triangle["indices"]
    if hasattr(source, "verts_list") and hasattr(source, "faces_list"):  # PyTorch3D
        return _only(source.verts_list(), "meshes"), _only(source.faces_list(), "meshes")
    if hasattr(source, "points") and isinstance(getattr(source, "cells", None), list):  # meshio
        return source.points, polygons_of_cells((block.type, block.data) for block in source.cells)
    if hasattr(source, "cells_dict") and hasattr(source, "extract_surface"):  # PyVista's UnstructuredGrid
        source = source.extract_surface()
    if hasattr(source, "points") and hasattr(source, "n_strips"):  # PyVista's PolyData
        source = source.triangulate() if source.n_strips else source
        return source.points, polygons_of_list(source.faces)
    if hasattr(source, "batching") and hasattr(source, "vertices"):  # Kaolin
        return _unbatched(source.vertices, 2), _unbatched(source.faces, 2)
    for faces in ("faces", "triangles", "cells"):  # the last one of vedo, where `faces` was a method once
        if hasattr(source, "vertices") and not callable(getattr(source, faces, len)):
            return source.vertices, _rectangular(getattr(source, faces))
    return None


def is_frame(source: object) -> bool:
    """Whether this is a data frame, as of pandas or polars: an object with named columns."""
    return hasattr(source, "columns") and (hasattr(source, "iloc") or hasattr(source, "get_column"))


def _columns(frame: Any) -> tuple[Any, Any | None]:
    names = {str(name).lower(): name for name in frame.columns}
    wanted = _COORDINATES if names.keys() >= set(_COORDINATES) else tuple(names)
    if len(wanted) != len(_COORDINATES):
        raise InputError(
            f"the data frame has the columns {', '.join(map(str, frame.columns))}; x, y and z were expected, or three."
        )
    has_normals = wanted == _COORDINATES and names.keys() >= set(_NORMALS)

    def stacked(which: tuple[str, ...]) -> Any:
        return np.stack([np.asarray(frame[names[name]]) for name in which], axis=1)

    return stacked(wanted), stacked(_NORMALS) if has_normals else None


def _only(batch: Any, what: str) -> Any:
    """The only item of a batch."""
    if len(batch) != 1:
        raise InputError(f"the batch holds {len(batch)} {what}; pass one of them: batch[0].")
    return batch[0]


def _unbatched(values: Any, ndim: int) -> Any:
    """A tensor without its batch axis; the only one of a list."""
    return values if getattr(values, "ndim", None) == ndim else _only(values, "meshes")


def _rectangular(faces: Any) -> Any:
    """Lists of polygons of different sizes as padded rows; anything else as it is."""
    if not isinstance(faces, list | tuple) or len({np.size(row) for row in faces}) <= 1:
        return faces
    counts = np.array([np.size(row) for row in faces])
    return padded_polygons(np.concatenate([np.ravel(row) for row in faces]), counts)


def _is_scene(source: object) -> bool:
    return hasattr(source, "dump") and hasattr(source, "to_mesh")


def _has(attributes: Any, name: str) -> bool:
    """Whether this is a mapping, such as open3d's TensorMap, with this entry."""
    return hasattr(attributes, "__contains__") and hasattr(attributes, "__getitem__") and name in attributes
