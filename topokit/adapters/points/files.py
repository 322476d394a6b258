"""Reading point files: one short function per format, each giving points (N, 3) and normals (N, 3) or None."""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.points.entry import LAS, POINTS, TEXT, is_pcd
from topokit.errors import MissingDependencyError, ReadError, reading
from topokit.inputs.files import ZIP, head
from topokit.inputs.numpy_header import NUMPY

Floats = NDArray[np.float64]
Cloud = tuple[Floats, Floats | None]
_SEPARATORS = re.compile(r"[,;]")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.IGNORECASE)
_ARRAY_WIDTHS = "(N, 3) for points or (N, 6) for points and normals"


def read_points(path: Path) -> Cloud:
    """Points and normals of a file, by content; what remains is text if its suffix says so.

    Raises:
        ReadError: if the file is malformed or holds no points.
        MissingDependencyError: if the format's reader is not installed.
    """
    reader = _reader(path)
    with reading(path, f"the {reader.__name__.removeprefix('_read_')} reader", extra="topokit[formats]"):
        points, normals = reader(path)
    if len(points) == 0:
        raise ReadError(f"{path} holds no points.")
    return points, normals


def _reader(path: Path) -> Callable[[Path], Cloud]:
    beginning = head(path)
    for magic, reader in _BY_MAGIC.items():
        if beginning.startswith(magic):
            return reader
    if is_pcd(beginning):
        return _read_pcd
    if path.suffix.lower() in TEXT:
        return _read_text
    raise ReadError(
        f"{path} is not a point file: text needs one of the suffixes {', '.join(TEXT)}, and its content is that of "
        f"none of the other formats. Known: {', '.join(POINTS.suffixes)}."
    )


def _split(table: Floats, path: Path) -> Cloud:
    """Columns x y z, or x y z nx ny nz; further columns (colour, intensity) are left alone."""
    if table.ndim != 2 or table.shape[1] < 3:
        raise ReadError(f"{path} has shape {table.shape}; {_ARRAY_WIDTHS} was expected.")
    has_normals = table.shape[1] >= 6 and _are_normals(table[:, 3:6])
    return np.ascontiguousarray(table[:, :3]), np.ascontiguousarray(table[:, 3:6]) if has_normals else None


def _are_normals(columns: Floats) -> bool:
    """Unit vectors (to 10 %) or zeros: columns 4 to 6 may as well be colours."""
    lengths = np.linalg.norm(columns[np.isfinite(columns).all(axis=1)], axis=1)
    return len(lengths) > 0 and bool((((lengths > 0.9) & (lengths < 1.1)) | (lengths == 0)).mean() > 0.9)


def _read_text(path: Path) -> Cloud:
    """Numbers in columns, separated by blanks, commas or semicolons; a header or a count line may come first."""
    with path.open(encoding="utf-8-sig") as file:
        lines = (_SEPARATORS.sub(" ", line.partition("#")[0]) for line in file)
        first = next((line for line in lines if _is_row(line)), None)
        if first is None:
            raise ReadError(f"{path} holds no row of at least three numbers.")
        columns = range(min(len(first.split()), 6))
        table = np.loadtxt(itertools.chain([first], lines), usecols=columns, ndmin=2)
    return _split(table, path)


def _is_row(line: str) -> bool:
    words = line.split()
    return len(words) >= 3 and all(_NUMBER.fullmatch(word) for word in words[:3])


def _read_npy(path: Path) -> Cloud:
    return _split(np.asarray(np.load(path, allow_pickle=False), dtype=np.float64), path)


def _read_npz(path: Path) -> Cloud:
    with np.load(path, allow_pickle=False) as archive:
        names = {name.lower(): name for name in archive.files}
        points = next((names[key] for key in ("points", "xyz", "pos", "vertices") if key in names), None)
        if points is None and len(archive.files) == 1:
            points = archive.files[0]
        if points is None:
            raise ReadError(f"{path} holds the arrays {', '.join(archive.files)}; one called 'points' was expected.")
        table = np.asarray(archive[points], dtype=np.float64)
        if "normals" not in names:
            return _split(table, path)
        return _split(table, path)[0], np.asarray(archive[names["normals"]], dtype=np.float64)


def _read_ply(path: Path) -> Cloud:
    from plyfile import PlyData, PlyParseError

    with reading(path, "plyfile", PlyParseError):
        vertex = PlyData.read(str(path))["vertex"].data
    return _from_fields(vertex, ("nx", "ny", "nz"), path)


def _read_pcd(path: Path) -> Cloud:
    try:
        from pypcd4 import PointCloud
    except ImportError as error:
        raise MissingDependencyError('Reading .pcd needs pypcd4: pip install "topokit[formats]".') from error
    # Versions .5 and .6 only lack header lines that have defaults; pypcd4 knows .7 alone.
    content = re.sub(rb"^VERSION .*$", b"VERSION .7", path.read_bytes(), count=1, flags=re.MULTILINE)
    cloud = PointCloud.from_fileobj(io.BytesIO(content))
    return _from_fields(cloud.pc_data, ("normal_x", "normal_y", "normal_z"), path)


def _read_las(path: Path) -> Cloud:
    try:
        import laspy
    except ImportError as error:
        raise MissingDependencyError('Reading .las needs laspy: pip install "topokit[formats]".') from error
    with reading(path, "laspy", laspy.errors.LaspyException, extra="topokit[formats]"):
        file = laspy.read(path)
    return np.stack((file.x, file.y, file.z), axis=1).astype(np.float64), None


def _from_fields(table: NDArray[np.void], normal_names: tuple[str, str, str], path: Path) -> Cloud:
    names = table.dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise ReadError(f"{path} has the fields {', '.join(names)}; x, y and z were expected.")
    points = np.stack([table[name] for name in "xyz"], axis=1).astype(np.float64)
    if not set(normal_names) <= set(names):
        return points, None
    return points, np.stack([table[name] for name in normal_names], axis=1).astype(np.float64)


_BY_MAGIC: dict[bytes, Callable[[Path], Cloud]] = {
    b"ply": _read_ply,
    LAS: _read_las,
    NUMPY: _read_npy,
    ZIP: _read_npz,
}
