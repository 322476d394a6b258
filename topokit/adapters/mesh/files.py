"""Reading mesh files: trimesh for every format it knows, and polygon OFF files, on which it fails."""

from __future__ import annotations

import io
import logging
import re
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.mesh.polygons import fans
from topokit.adapters.mesh.scenes import load_flattened
from topokit.errors import ReadError
from topokit.inputs.files import head
from topokit.inputs.reading import reading

# What trimesh raises on damaged files, beside ValueError and the like.
_OF_TRIMESH = (
    *(ArithmeticError, AssertionError, AttributeError, LookupError, NotImplementedError, RuntimeError),
    *(StopIteration, SyntaxError, TypeError, UnboundLocalError),
)


def read_mesh(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) and triangles (F, 3) of a mesh file, indices as they stand in it (nothing is merged).

    Scenes are flattened with their transformations; polygons are cut into fans.

    Raises:
        ReadError: if the file cannot be read or holds no triangle.
        MissingDependencyError: if the format needs a package that is not there (3MF: lxml and networkx).
    """
    beginning = head(path)
    if beginning.lstrip()[:4].upper().startswith((b"OFF", b"COFF", b"NOFF")):
        with reading(path, "the OFF reader"):
            return read_off(path)
    quiet = logging.getLogger("trimesh")
    level = quiet.level
    quiet.setLevel(logging.CRITICAL)  # missing textures do not matter here
    try:
        kind = _file_type(path, beginning)
        content = path if kind != "obj" else _bare_obj(path)
        with reading(path, "trimesh", *_OF_TRIMESH, extra="topokit[formats]"):
            mesh = load_flattened(content, kind, path)
            vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    finally:
        quiet.setLevel(level)
    if len(faces) == 0:
        raise ReadError(f"{path} holds no triangles. A mesh was expected; for points use topokit.from_points.")
    return vertices, faces


def read_off(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """An ASCII OFF file with polygons of any size, cut into fans.

    Raises:
        ReadError: if counts and content do not agree.
    """
    lines = (line.split("#")[0] for line in path.read_text(encoding="utf-8", errors="strict").splitlines())
    words = [line.split() for line in lines]
    rows = [row for row in words if row]
    if not rows or not rows[0][0].upper().endswith("OFF"):
        raise ReadError(f"{path} is not an OFF file: it does not begin with OFF.")
    rows[0] = rows[0][1:]
    rows = rows if rows[0] else rows[1:]
    if not rows or len(rows[0]) < 2:
        raise ReadError(f"{path} has no vertex and face counts after its first word; it is truncated.")
    n_vertices, n_faces = int(rows[0][0]), int(rows[0][1])
    if len(rows) < 1 + n_vertices + n_faces:
        raise ReadError(
            f"{path} announces {n_vertices} vertices and {n_faces} faces but has only {len(rows) - 1} lines for them: "
            "it is truncated or its header is wrong."
        )
    vertices = np.array([row[:3] for row in rows[1 : 1 + n_vertices]], dtype=np.float64).reshape(-1, 3)
    polygons = [row for row in rows[1 + n_vertices : 1 + n_vertices + n_faces] if int(row[0]) > 2]
    if not polygons:
        raise ReadError(f"{path} holds no faces. A mesh was expected; for points use topokit.from_points.")
    counts = np.array([int(row[0]) for row in polygons])
    short = next((row for row, count in zip(polygons, counts, strict=True) if len(row) <= count), None)
    if short is not None:
        raise ReadError(f"{path}: a face announces {short[0]} corners and has {len(short) - 1}.")
    words_of_corners = chain.from_iterable(row[1 : 1 + n] for row, n in zip(polygons, counts.tolist(), strict=True))
    return vertices, fans(np.array(list(map(int, words_of_corners)), dtype=np.int64), counts)


def _bare_obj(path: Path) -> io.BytesIO:
    """The `v` and `f` lines alone, faces without texture and normal indices.

    Faces name vertices, normals, textures and materials apart and topology goes by the vertex alone; trimesh would
    split vertices wherever any of them differs.
    """
    content = path.read_bytes().replace(b"\t", b" ")
    if b"\\" in content:
        content = re.sub(rb"\\\r?\n", b" ", content)  # continued lines
    lines = b"\n".join(line for line in map(bytes.strip, content.split(b"\n")) if line[:2] in (b"v ", b"f "))
    superfluous = rb"/\S*|#.*"
    return io.BytesIO(re.sub(superfluous, b"", lines) if b"/" in lines or b"#" in lines else lines)


def _file_type(path: Path, beginning: bytes) -> str:
    """What the content says, else the suffix."""
    if beginning.startswith(b"ply"):
        return "ply"
    if beginning.startswith(b"glTF"):
        return "glb"
    if beginning.startswith(b"PK\x03\x04"):
        return "3mf"
    return path.suffix.lower().removeprefix(".")
