"""Cells of finite-element meshes as polygons: those of surfaces as they are, of solids the faces that bound them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from topokit.errors import InputError

Integers = NDArray[np.int64]
_CORNERS = {"triangle": 3, "quad": 4, "polygon": None}  # all of a polygon's nodes are corners
_NO_FACES = ("vertex", "line", "poly_line", "poly_vertex")
# Faces of solid cells by the numbers of their corners, as in VTK, gmsh and meshio; each edge occurs in both directions.
_FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}


def polygons_of_cells(cells: Iterable[tuple[str, Any]]) -> Integers:
    """The surface of cells.

    Solid cells take precedence: then the surface is that of the solid, the faces that belong to one cell alone, and
    cells of surfaces are left out, as finite-element files repeat their boundary in them. Of cells of higher order the
    corners are taken.

    Args:
        cells: (type, nodes) of each block, with the names of meshio ("triangle", "quad8", "tetra10", ...).

    Returns:
        (F, n) node numbers, with −1 after the last corner of smaller polygons; (0, 3) without faces.

    Raises:
        InputError: for cells of another type.
    """
    surfaces: list[Integers] = []
    solids: list[Integers] = []
    for name, nodes in cells:
        kind = re.sub(r"\d+$", "", name)
        rows = np.asarray(nodes, dtype=np.int64).reshape(len(nodes), -1)
        if kind in _FACES:
            solids.extend(rows[:, corners] for corners in _FACES[kind])
        elif kind in _CORNERS:
            surfaces.append(rows[:, : _CORNERS[kind]])
        elif kind not in _NO_FACES and len(rows):
            known = ", ".join((*_CORNERS, *_FACES))
            raise InputError(f"the mesh has cells of type {name!r}; expected {known}: split them before.")
    if not any(map(len, solids)):
        return _padded(surfaces)
    faces = _padded(solids)
    _, first, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[counts == 1])]


def polygons_of_list(numbers: Any) -> Integers:
    """Polygons from the list of VTK, each as the number of its corners followed by them: 3, a, b, c, 4, d, e, f, g.

    Returns:
        (F, n), padded as above.

    Raises:
        InputError: if the numbers end within a polygon.
    """
    flat = np.asarray(numbers, dtype=np.int64).ravel()
    size = int(flat[0]) if len(flat) else 3
    if size > 0 and len(flat) % (size + 1) == 0 and (flat[:: size + 1] == size).all():  # all of one size
        return flat.reshape(-1, size + 1)[:, 1:]
    starts, at = [], 0
    while at < len(flat) and flat[at] >= 0:
        starts.append(at)
        at += int(flat[at]) + 1
    if at != len(flat):
        raise InputError(f"the list of faces ends within face {len(starts) - 1}: {len(flat)} numbers, {at} announced.")
    counts = flat[starts]
    is_corner = np.ones(len(flat), dtype=bool)
    is_corner[starts] = False
    return padded_polygons(flat[is_corner], counts)


def padded_polygons(corners: Integers, counts: Integers) -> Integers:
    """Polygons of any size as rows with −1 after the last corner.

    Args:
        corners: of all polygons, one after the other.
        counts: (F,) number of corners of each.
    """
    rows = np.full((len(counts), max(3, int(counts.max(initial=3)))), -1, dtype=np.int64)
    rows[np.arange(rows.shape[1]) < counts[:, None]] = corners
    return rows


def _padded(blocks: list[Integers]) -> Integers:
    """Blocks of polygons one below the other, as wide as the widest."""
    width = max((block.shape[1] for block in blocks), default=3)
    parts = [np.pad(block, ((0, 0), (0, width - block.shape[1])), constant_values=-1) for block in blocks]
    return np.concatenate(parts) if parts else np.empty((0, 3), dtype=np.int64)
