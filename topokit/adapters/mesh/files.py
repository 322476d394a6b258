"""Reading mesh files: trimesh, helped where it fails; meshio for finite elements."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.mesh.entry import FINITE_ELEMENTS
from topokit.adapters.mesh.formats.finite_elements import read_finite_elements
from topokit.adapters.mesh.formats.gltf import check_gltf
from topokit.adapters.mesh.formats.obj import bare_obj
from topokit.adapters.mesh.formats.off import read_off
from topokit.adapters.mesh.formats.ply import is_plain, read_ply
from topokit.adapters.mesh.formats.stl import counted_stl, is_binary_stl
from topokit.adapters.mesh.formats.three_mf import check_3mf
from topokit.adapters.mesh.formats.xml import refuse_entities
from topokit.adapters.mesh.scenes import load_flattened
from topokit.errors import FOR_POINTS, MissingDependencyError, ReadError
from topokit.inputs.files import head
from topokit.inputs.ply import check_header
from topokit.inputs.reading import quiet, reading

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]

# What trimesh raises on damaged files, beside ValueError and the like.
_OF_TRIMESH = (
    *(ArithmeticError, AssertionError, AttributeError, LookupError, NotImplementedError, RuntimeError),
    *(StopIteration, SyntaxError, TypeError, UnboundLocalError),
)


def read_mesh(path: Path) -> Mesh:
    """Vertices (V, 3) and triangles (F, 3) of a mesh file, indices as they stand in it (nothing is merged).

    Scenes are flattened with their transformations; polygons are cut into fans; of solid cells the surface is taken.

    Raises:
        ReadError: if the file cannot be read or holds no triangle.
        MissingDependencyError: if the format needs a package that is not there.
    """
    kind = _file_type(path, head(path))
    if kind == "off":
        with reading(path, "the OFF reader"):
            vertices, faces = read_off(path)
    elif f".{kind}" in FINITE_ELEMENTS:
        vertices, faces = read_finite_elements(path, FINITE_ELEMENTS[f".{kind}"])
    elif kind == "ply" and not is_plain(path):
        with reading(path, "the PLY reader"):
            vertices, faces = read_ply(path)
    else:
        vertices, faces = _through_trimesh(path, kind)
    if len(faces) == 0:
        raise ReadError(f"{path} holds no triangles. A mesh was expected; for points use ", FOR_POINTS, ".")
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ReadError(f"{path} has vertices of shape {vertices.shape}; three coordinates of each are expected.")
    return vertices, faces


def _through_trimesh(path: Path, kind: str) -> Mesh:
    with reading(path, f"the {kind.upper()} reader"):
        content = _prepared(path, kind)
    errors: tuple[type[Exception], ...] = (*_OF_TRIMESH, *_of_collada()) if kind == "dae" else _OF_TRIMESH
    with quiet("trimesh"), reading(path, "trimesh", *errors, extra="topokit[formats]"):
        mesh = load_flattened(content, kind, path)
        return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


def _prepared(path: Path, kind: str) -> Path | io.BytesIO:
    """The file as trimesh reads it rightly; what it would misread is refused."""
    if kind == "obj":
        return bare_obj(path)
    if kind == "stl" and is_binary_stl(path):
        return counted_stl(path)
    if kind in ("glb", "gltf"):
        check_gltf(path)
    if kind == "3mf":
        check_3mf(path)
    if kind == "ply":
        check_header(path)
    if kind == "dae":
        refuse_entities(path)
    return path


def _of_collada() -> tuple[type[Exception], ...]:
    try:
        from collada.common import DaeError
    except ImportError as error:
        raise MissingDependencyError('Reading .dae needs pycollada: pip install "topokit[formats]".') from error
    return (DaeError,)


def _file_type(path: Path, beginning: bytes) -> str:
    """What the content says, else the suffix."""
    if re.match(rb"\s*(C|N)?OFF", beginning, re.IGNORECASE):
        return "off"
    if beginning.startswith(b"ply"):
        return "ply"
    if beginning.startswith(b"glTF"):
        return "glb"
    if b"<VTKFile" in beginning[:1024]:
        return "vtu"
    if beginning.startswith(b"PK\x03\x04"):
        return "3mf"
    return path.suffix.lower().removeprefix(".")
