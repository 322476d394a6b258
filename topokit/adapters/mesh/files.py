"""Reading mesh files: trimesh, helped where it fails; meshio for finite elements."""

from __future__ import annotations

import io
import pkgutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.mesh.entry import FORMATS, MESH
from topokit.adapters.mesh.formats.gltf import check_gltf
from topokit.adapters.mesh.formats.obj import bare_obj
from topokit.adapters.mesh.formats.off import read_off
from topokit.adapters.mesh.formats.ply import is_plain, read_ply
from topokit.adapters.mesh.formats.stl import counted_stl
from topokit.adapters.mesh.formats.three_mf import check_3mf
from topokit.adapters.mesh.formats.xml import refuse_entities
from topokit.adapters.mesh.scenes import load_flattened
from topokit.errors import FOR_POINTS, ReadError, requiring
from topokit.inputs.files import head
from topokit.inputs.formats import format_of
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
    found = format_of(FORMATS, path, else_by_suffix=True)
    if found is None:
        raise ReadError(f"{path} is no mesh by its content or its suffix. Known: {', '.join(MESH.suffixes)}.")
    vertices, faces = pkgutil.resolve_name(str(found.read))(path)
    if len(faces) == 0:
        raise ReadError(f"{path} holds no triangles. A mesh was expected; for points use ", FOR_POINTS, ".")
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ReadError(f"{path} has vertices of shape {vertices.shape}; three coordinates of each are expected.")
    return vertices, faces


def read_off_file(path: Path) -> Mesh:
    """By lines."""
    with reading(path, "the OFF reader"):
        return read_off(path)


def read_ply_file(path: Path) -> Mesh:
    """Through trimesh where that is quick and right."""
    if is_plain(path):
        check_header(path)
        return _through_trimesh(path, "ply")
    with reading(path, "the PLY reader"):
        return read_ply(path)


def read_gltf(path: Path) -> Mesh:
    """Through trimesh, if it is not compressed."""
    return _through_trimesh(path, "glb" if head(path).startswith(b"glTF") else "gltf", check_gltf)


def read_dae(path: Path) -> Mesh:
    """Through pycollada and trimesh."""
    with requiring('Reading .dae needs pycollada: pip install "topokit[formats]".'):
        from collada.common import DaeError
    return _through_trimesh(path, "dae", refuse_entities, (*_OF_TRIMESH, DaeError))


def _through_trimesh(
    path: Path,
    kind: str,
    prepare: Callable[[Path], Path | io.BytesIO | None] = lambda path: path,
    damaged: tuple[type[Exception], ...] = _OF_TRIMESH,
) -> Mesh:
    """A file as trimesh reads it.

    Args:
        path: the file.
        kind: the format, as the suffix without its dot.
        prepare: refuses what trimesh would misread, and gives what it reads rightly instead of the file, if need be.
        damaged: what it raises on damaged files.
    """
    with reading(path, f"the {kind.upper()} reader"):
        content = prepare(path) or path
    with quiet("trimesh"), reading(path, "trimesh", *damaged, extra="topokit[formats]"):
        mesh = load_flattened(content, kind, path)
        return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


read_obj = partial(_through_trimesh, kind="obj", prepare=bare_obj)
read_stl = partial(_through_trimesh, kind="stl", prepare=counted_stl)
read_3mf = partial(_through_trimesh, kind="3mf", prepare=check_3mf)
