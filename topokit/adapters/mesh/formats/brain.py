"""Surfaces of neuroimaging, GIFTI and FreeSurfer, through nibabel."""

from __future__ import annotations

import base64
import zlib
from pathlib import Path
from xml.parsers.expat import ExpatError, ParserCreate

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.mesh.entry import FREESURFER_START
from topokit.errors import ReadError, requiring
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import most_expanded, require_bytes, require_expansion

_MOST_AXES = 6  # of an array, in the definition of GIFTI
_STEP = 1 << 20  # bytes decompressed at a time
_HOW = 'needs nibabel: pip install "topokit[formats]".'


def read_gifti(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) and triangles (F, 3) as they are stored, in millimeters; no transformation is applied.

    Raises:
        ReadError: if the file is malformed, expands absurdly, keeps its numbers elsewhere or is no surface.
        MissingDependencyError: without nibabel.
    """
    with requiring(f"Reading .gii {_HOW}"):
        from nibabel.gifti import GiftiImage
        from nibabel.gifti.parse_gifti_fast import GiftiParseError
    content = path.read_bytes()
    damaged = (
        *(GiftiParseError, ExpatError, AssertionError, AttributeError),
        *(LookupError, NotImplementedError, TypeError),
    )
    with reading(path, "nibabel", *damaged):
        _check_gifti(path, content)
        image = GiftiImage.from_bytes(content)  # without a place on the disk, beside which it would look for numbers
        points, triangles = (
            [array.data for array in image.get_arrays_from_intent(f"NIFTI_INTENT_{name}")]
            for name in ("POINTSET", "TRIANGLE")
        )
    if (len(points), len(triangles)) != (1, 1):
        raise ReadError(
            f"{path} holds {len(points)} arrays of points and {len(triangles)} of triangles; one of each was expected, "
            "as in files called .surf.gii."
        )
    return points[0].astype(np.float64), triangles[0].astype(np.int64)


def read_freesurfer(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) and triangles (F, 3) of a surface such as lh.white, in FreeSurfer's surface coordinates.

    Raises:
        ReadError: if the file is malformed.
        MissingDependencyError: without nibabel.
    """
    with requiring(f"Reading {path.name} {_HOW}"):
        from nibabel.freesurfer import read_geometry
    with reading(path, "nibabel", LookupError):
        _check_counts(path)
        vertices, faces = read_geometry(str(path))
    return np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)


def _check_counts(path: Path) -> None:
    """Refuse a surface of FreeSurfer of another kind, and one that announces more than the file holds."""
    with path.open("rb") as file:
        if (start := file.read(3)) != FREESURFER_START:
            raise ReadError(f"{path} begins with {start!r}, and a surface of FreeSurfer with {FREESURFER_START!r}.")
        file.readline()  # who wrote it
        file.readline()  # empty
        n_vertices, n_faces = np.frombuffer(file.read(8), ">i4").tolist()
        what, size = f"{n_vertices} vertices and {n_faces} triangles", path.stat().st_size
        require_bytes(path, what, 12 * (abs(n_vertices) + abs(n_faces)), size - file.tell())


def _check_gifti(path: Path, content: bytes) -> None:
    """Refuse XML entities, arrays of absurdly many axes, and compressed ones that expand absurdly: nibabel decompresses
    them whole."""
    n_unpacked, words = 0, list[str]()

    def start(name: str, attributes: dict[str, str]) -> None:
        words.clear()
        if int(attributes.get("Dimensionality", 0)) > _MOST_AXES:
            raise ReadError(f"{path} announces an array of {attributes['Dimensionality']} axes; its header is wrong.")

    def end(name: str) -> None:
        nonlocal n_unpacked
        if name == "Data":
            n_unpacked += _unpacked_size("".join(words))
            require_expansion(path, n_unpacked, len(content))

    def refuse(*declared: object) -> None:
        raise ReadError(f"{path} defines XML entities, which such files do not need: it is not read.")

    parser = ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.EntityDeclHandler = words.append, refuse
    parser.Parse(content, True)


def _unpacked_size(text: str) -> int:
    """Bytes to which an array expands, at most a little more than is read of any file; 0 if it is not compressed."""
    try:
        packed, stream = base64.b64decode(text), zlib.decompressobj()
    except ValueError:  # numbers as text
        return 0
    size, most = 0, most_expanded(len(packed))
    while packed and not stream.eof and size <= most:
        try:
            size += len(stream.decompress(packed, _STEP))
        except zlib.error:
            return size
        packed = stream.unconsumed_tail
    return size
