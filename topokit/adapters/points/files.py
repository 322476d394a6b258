"""Point files: the reader of each format, chosen by the table in `entry`."""

from __future__ import annotations

import io
import os
import pkgutil
import re
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from topokit.adapters.points.entry import FORMATS, POINTS, TEXT, is_obj_cloud
from topokit.adapters.points.stored_clouds import NAMES, Cloud, MappedCloud, StoredCloud, split, whole
from topokit.adapters.points.text import Layout, TextCloud
from topokit.core.arrays import Floats
from topokit.errors import FOR_MESHES, ReadError, requiring
from topokit.inputs.files import head
from topokit.inputs.formats import format_of
from topokit.inputs.headers import array_shapes
from topokit.inputs.ply import check_header, ply_elements
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import require_bytes, require_expansion

_PCD_LINES = 10
_INSTALL = 'pip install "topokit[formats]"'


def read_points(path: Path) -> Cloud:
    """Points (N, 3) and normals (N, 3) or None, by the content of the file; text also needs one of its suffixes.

    Raises:
        ReadError: if the file is malformed or holds no points.
        MissingDependencyError: if the format's reader is not installed.
    """
    found = format_of(FORMATS, path)
    if found is not None:
        quiet = np.errstate(all="ignore")  # rows that are not finite are dropped and counted
        with quiet, reading(path, f"the {found.name} reader", extra="topokit[formats]"):
            made = pkgutil.resolve_name(found.read or str(found.stored))(path)
            points, normals = made if found.read else whole(made)
        if len(points) == 0:
            raise ReadError(f"{path} holds no points.")
        return points, normals
    raise ReadError(
        f"{path} is not a point file: text needs one of the suffixes {', '.join(TEXT)}, and its content is that of "
        f"none of the other formats. Known: {', '.join(POINTS.suffixes)}."
    )


def read_ply(path: Path) -> Cloud:
    elements = ply_elements(path)
    if "vertex" not in elements:
        raise ReadError(f"{path} has the elements {', '.join(elements) or 'none'}; 'vertex' was expected.")
    return _from_fields(elements["vertex"], ("nx", "ny", "nz"), path)


def ply_cloud(path: Path) -> StoredCloud | None:
    """The vertices, if they are records of numbers; of text only if there is nothing else in it."""
    header = check_header(path)
    counts = {name: int(n) for name, n in re.findall(rb"^element\s+(\S+)\s+(\d+)", header, re.MULTILINE)}
    if not counts.get(b"vertex") or b"property list" in header:
        return None
    if b"format ascii" not in header:
        mapped = ply_elements(path)["vertex"]
        names = _fields(list(mapped.dtype.names or ()))
        if names is None or not isinstance(mapped, np.memmap) or str(mapped.filename) != os.path.abspath(path):
            return None
        return MappedCloud(mapped, names)
    names = _fields([name.decode("latin-1") for name in re.findall(rb"^property\s+\w+\s+(\S+)", header, re.MULTILINE)])
    if sum(counts.values()) > counts[b"vertex"] or names is None:
        return None
    every = re.findall(rb"^property\s+\w+\s+(\S+)", header, re.MULTILINE)
    columns = tuple(every.index(name.encode()) for name in names)
    return TextCloud(path, Layout(len(header), columns, str), len(names) == len(NAMES))


def _fields(names: list[str]) -> tuple[str, ...] | None:
    """The fields of coordinates, and of normals if there are all; None if there are no coordinates."""
    if not set(NAMES[:3]) <= set(names):
        return None
    return NAMES if set(NAMES) <= set(names) else NAMES[:3]


def read_e57(path: Path) -> Cloud:
    """The scans of a file one after the other, in their common coordinates; points that are marked invalid left out."""
    with requiring(f"Reading .e57 needs pye57: {_INSTALL}."):
        import pye57
    length = int.from_bytes(head(path)[16:24], "little")
    require_bytes(path, "its own length", length, path.stat().st_size)
    damaged = (RuntimeError, LookupError, TypeError, AttributeError, pye57.libe57.E57Exception)
    with reading(path, "pye57", *damaged), pye57.E57(str(path)) as file:
        for number in range(file.scan_count):
            n_points = file.get_header(number).point_count
            require_expansion(path, 3 * n_points, path.stat().st_size)  # coordinates take a byte at least, seldom less
        scans = [file.read_scan(number, ignore_missing_fields=True) for number in range(file.scan_count)]
        columns = [[scan[f"cartesian{axis}"] for axis in "XYZ"] for scan in scans]
    return np.concatenate([np.empty((0, 3)), *(np.stack(column, axis=1) for column in columns)]), None


def read_obj(path: Path) -> Cloud:
    """The vertices, and as many normals as there are, if there are so many; colors behind the vertices are ignored."""
    if not is_obj_cloud(path):
        raise ReadError(f"{path} has faces, or no vertices at all: ", FOR_MESHES, " reads its faces.")
    rows: dict[bytes, list[list[bytes]]] = {b"v": [], b"vn": []}
    with path.open("rb") as file:
        for line in file:
            words = line.split()
            if len(words) > 3 and words[0] in rows:
                rows[words[0]].append(words[1:4])
    points, normals = (np.array(rows[key], dtype=np.float64).reshape(-1, 3) for key in (b"v", b"vn"))
    return points, normals if len(points) == len(normals) else None


def read_pcd(path: Path) -> Cloud:
    with requiring(f"Reading .pcd needs pypcd4: {_INSTALL}."):
        from pypcd4 import MetaData, PointCloud
    # Versions .5 and .6 only lack header lines that have defaults; pypcd4 accepts .7 alone.
    content = re.sub(rb"^VERSION .*$", b"VERSION .7", path.read_bytes(), count=1, flags=re.MULTILINE)
    found = re.match(rb".*?^DATA[ \t]+(\w+)[^\n]*\n", content, re.DOTALL | re.MULTILINE)
    if found is None:
        raise ReadError(f"{path} has no complete .pcd header: it is truncated.")
    lines = [line for line in map(bytes.strip, found.group().splitlines()) if line and not line.startswith(b"#")]
    if len(lines) > _PCD_LINES:  # pypcd4 takes what follows for compressed points
        raise ReadError(f"{path} has a header of {len(lines)} lines; a .pcd file has at most {_PCD_LINES}.")
    damaged = (LookupError, TypeError, RuntimeError)
    with reading(path, "pypcd4", *damaged):
        header = MetaData.parse_header(found.group().decode("utf-8").splitlines())
        require_bytes(path, "values of each point", sum(header.count), len(content))
        needed = header.points * header.build_dtype().itemsize
    available = len(content) - found.end()
    if found.group(1) == b"binary_compressed":
        require_expansion(path, needed, available)
        packed, unpacked = struct.unpack_from("<II", content, found.end())
        require_bytes(path, "compressed points", packed, available - 8)
        require_bytes(path, f"{header.points} points", needed, unpacked)
        require_expansion(path, unpacked, available)
    elif found.group(1) == b"binary":
        require_bytes(path, f"{header.points} points", needed, available)
    with reading(path, "pypcd4", *damaged):
        cloud = PointCloud.from_fileobj(io.BytesIO(content))
    return _from_fields(cloud.pc_data, ("normal_x", "normal_y", "normal_z"), path)


def read_npy(path: Path) -> Cloud:
    array_shapes(path)  # refuses a header that does not fit the file
    return split(_numbers(np.load(path, allow_pickle=False), path), path)


def npy_cloud(path: Path) -> StoredCloud | None:
    """The rows of an array of two axes as a memory map."""
    if len(array_shapes(path).get("", ())) != 2:
        return None
    with reading(path, "the NumPy reader"):
        return MappedCloud(np.load(path, mmap_mode="r", allow_pickle=False))


def read_npz(path: Path) -> Cloud:
    names = list(array_shapes(path))
    likely = ("points", "xyz", "pos", "vertices", *(names if len(names) == 1 else ()))
    points = next((name for name in likely if name in names), None)
    if points is None:
        raise ReadError(f"{path} holds the arrays {', '.join(names)}; one called 'points' was expected.")
    with np.load(path, allow_pickle=False) as archive:
        stored = {name.lower(): name for name in archive.files}
        positions, normals = split(_numbers(archive[stored[points]], path), path)
        return positions, _numbers(archive[stored["normals"]], path) if "normals" in stored else normals


def _from_fields(table: NDArray[np.void], normal_names: tuple[str, str, str], path: Path) -> Cloud:
    """Points and normals from the columns of a structured array, by their names."""
    names = [name for name in table.dtype.names or () if table.dtype[name].kind != "O"]  # "O": a list
    if not {"x", "y", "z"} <= set(names):
        raise ReadError(f"{path} has the fields {', '.join(names)}; x, y and z were expected.")
    points = np.stack([table[name] for name in "xyz"], axis=1).astype(np.float64)
    if not set(normal_names) <= set(names):
        return points, None
    return points, np.stack([table[name] for name in normal_names], axis=1).astype(np.float64)


def _numbers(array: NDArray[np.generic], path: Path) -> Floats:
    if array.dtype.kind not in "biuf":
        raise ReadError(f"{path} holds an array of {array.dtype}; real numbers were expected.")
    return np.asarray(array, dtype=np.float64)
