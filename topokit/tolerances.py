"""Why checkers disagree about a mesh file: its counts with vertices merged in several ways, and after round trips."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from topokit.adapters.mesh.counting import count_mesh
from topokit.adapters.mesh.files import read_mesh
from topokit.core.arrays import Floats, Integers
from topokit.core.mesh.topology import MeshTopology, mesh_topology
from topokit.core.mesh.welding import equal_vertices, may_have_near, near_vertices
from topokit.core.surface import TriangleSurface
from topokit.export.trimesh import as_trimesh
from topokit.inputs.files import existing_file
from topokit.inputs.unpacking import unpacked

WIDE = 1e-4  # share of the bounding box's diagonal, a usual tolerance of slicers and repair tools
_DIGITS = 6  # significant, as many exporters of text write them
_ROUND_TRIPS = (".stl", ".obj", ".ply", ".glb")


@dataclass(frozen=True)
class ToleranceRow:
    """What counting says about one reading of a mesh.

    Attributes:
        reading: which vertices are one, or what the mesh was written to and read from.
        vertices: that faces use.
        faces: with three different vertices.
        euler: V − E + F.
        components: joined by vertices.
        boundary_edges: edges with one face.
        nonmanifold_edges: edges with three faces or more.
        closed: whether every edge has two faces and every vertex one fan.
        genus: handles, or None where there is none.
    """

    reading: str
    vertices: int
    faces: int
    euler: int
    components: int
    boundary_edges: int
    nonmanifold_edges: int
    closed: bool
    genus: int | None


def tolerances(path: str | os.PathLike[str]) -> tuple[ToleranceRow, ...]:
    """The counts of a mesh file under the readings that other programs use.

    As topokit reads it and as it is stored; with vertices merged that are equal, that are equal in single precision or
    to six digits, or that lie within 1e-4 of the bounding box's diagonal; and as it is read again after it was written
    as STL, OBJ, PLY and glTF. Rows that differ show why checkers disagree about the file.

    Args:
        path: of a mesh.

    Raises:
        ReadError: if it is missing or malformed.
        InputError: if it has no area.
    """
    with unpacked(existing_file(path)) as plain:
        vertices, faces = read_mesh(plain)
    vertices = np.asarray(vertices, dtype=np.float64)
    rows = [_row("as topokit reads it", count_mesh(vertices, faces).topology)]
    for reading, first in _mergings(vertices):
        rows.append(_counted(reading, vertices, first[faces]))
    mesh = as_trimesh(TriangleSurface(vertices, faces))
    with tempfile.TemporaryDirectory(prefix="topokit-") as folder:
        for suffix in _ROUND_TRIPS:
            copy = Path(folder) / f"copy{suffix}"
            mesh.export(copy)
            rows.append(_row(f"written as {suffix} and read", count_mesh(*_as_double(read_mesh(copy))).topology))
    return tuple(rows)


def _mergings(vertices: Floats) -> Iterator[tuple[str, Integers]]:
    """By name the vertex that each one becomes."""
    yield "as stored", np.arange(len(vertices))
    yield "equal vertices merged", equal_vertices(vertices)
    yield "equal in single precision", equal_vertices(vertices.astype(np.float32).astype(np.float64))
    digits = np.array([f"{value:.{_DIGITS}g}" for value in vertices.ravel()], dtype=np.float64).reshape(-1, 3)
    yield f"equal to {_DIGITS} digits", equal_vertices(digits)
    radius = WIDE * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    yield f"within {WIDE:g} of the diagonal", near_vertices(vertices, radius, may_have_near(vertices, radius))


def _counted(reading: str, vertices: Floats, faces: Integers) -> ToleranceRow:
    a, b, c = faces.T
    proper = faces[(a != b) & (b != c) & (c != a)]
    if len(proper) == 0:
        return ToleranceRow(reading, 0, 0, 0, 0, 0, 0, closed=False, genus=None)
    return _row(reading, mesh_topology(vertices, proper))


def _row(reading: str, found: MeshTopology) -> ToleranceRow:
    return ToleranceRow(
        reading,
        vertices=len(np.unique(found.faces)),
        faces=len(found.faces),
        euler=found.euler,
        components=len(found.components),
        boundary_edges=found.boundary_edges,
        nonmanifold_edges=found.nonmanifold_edges,
        closed=found.is_closed,
        genus=found.genus,
    )


def _as_double(mesh: tuple[Floats, Integers]) -> tuple[Floats, Integers]:
    return np.asarray(mesh[0], dtype=np.float64), mesh[1]
