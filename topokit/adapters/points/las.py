"""LAS, and compressed LAZ if laspy has a backend for it: any part of the points, for which only its bytes are read.

What the table of chunks of a LAZ file announces is checked before a reader believes it.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from topokit.adapters.points.stored_clouds import Block, Cloud, StoredCloud
from topokit.errors import MissingDependencyError, ReadError, requiring, summary
from topokit.inputs.files import head
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import require_bytes, require_expansion

_INSTALL = 'pip install "topokit[formats]"'
_RECORD = struct.Struct("<HHBBHIIqqH")  # how points are packed, followed by the items of a point
_ITEM = struct.Struct("<HHH")
_LAYERED = b"\3\0"  # the compressor of points since LAS 1.4: each property is a layer
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # of an item by its type: point, color, color and infrared, wave; of bytes, each
_ANY_SIZE = (1 << 32) - 1  # of chunks: their table tells how many points each has


class LasCloud(StoredCloud):
    """The points of a file; it has no normals."""

    def __init__(self, path: Path) -> None:
        """Args: an existing file.

        Raises:
            ReadError: if its header announces more than it holds.
            MissingDependencyError: if laspy, or a backend for .laz, is not installed.
        """
        size = path.stat().st_size
        n_records = int.from_bytes(head(path)[100:104], "little")
        require_bytes(path, "points behind its header", int.from_bytes(head(path)[96:100], "little"), size)
        require_bytes(path, f"{n_records} variable length records", 54 * n_records, size)
        with _opened(path) as file:
            header = file.header
            needed = header.point_count * header.point_format.size
            if header.are_points_compressed:
                require_expansion(path, needed, size)
                _check_packing(path, header)
            else:
                require_bytes(path, f"{header.point_count} points", needed, size - header.offset_to_point_data)
            super().__init__(path, header.point_count, (0, header.point_count), False)

    def read(self, block: Block, most_points: int) -> Iterator[Cloud]:
        """See `StoredCloud`."""
        first, last = block
        with _opened(self.path) as file:
            file.seek(first)
            for start in range(first, last, most_points):
                n_points = min(most_points, last - start)
                points = file.read_points(n_points)
                if len(points) < n_points:
                    raise ReadError(f"{self.path} ends at point {start + len(points)} of {self.n_points}.")
                yield np.stack((points.x, points.y, points.z), axis=1).astype(np.float64), None


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """laspy's reader of a file; its errors are errors about the file."""
    with requiring(f"Reading .las needs laspy: {_INSTALL}."):
        import laspy
    damaged = (laspy.errors.LaspyException, AssertionError, LookupError, TypeError)
    with _reading_laz(path), reading(path, "laspy", *damaged), laspy.open(path, read_evlrs=False) as file:
        if file.header.are_points_compressed and not laspy.LazBackend.detect_available():
            raise MissingDependencyError("Reading .laz needs a backend of laspy: pip install lazrs.")
        yield file


def _check_packing(path: Path, header: Any) -> None:
    """Refuse a description of packed points that does not fit them, or more chunks than the file has bytes.

    laz-rs allocates chunks and their table at once, and ends the process if that fails.

    Args:
        path: a .laz file.
        header: that of laspy.

    Raises:
        ReadError: if there is no description of the packed points, or it announces more than can be.
    """
    records = header.vlrs.get("LasZipVlr")
    record = bytes(records[0].record_data) if records else b""
    require_bytes(path, "a description of its packed points", _RECORD.size, len(record))
    *_, n_points, _, _, n_items = _RECORD.unpack_from(record)
    require_bytes(path, f"{n_items} items of a point", _RECORD.size + n_items * _ITEM.size, len(record))
    items = list(_ITEM.iter_unpack(record[_RECORD.size : _RECORD.size + n_items * _ITEM.size]))
    width = sum(n_bytes for _, n_bytes, _ in items)
    if width != header.point_format.size:
        raise ReadError(f"{path} has points of {header.point_format.size} bytes, packed as {width}: it is damaged.")
    if n_points != _ANY_SIZE:
        require_expansion(path, n_points * width, path.stat().st_size)
    _check_chunks(path, header.offset_to_point_data)
    if record[:2] == _LAYERED:
        n_layers = sum(_LAYERS.get(kind, n_bytes) for kind, n_bytes, _ in items)
        _check_layers(path, header.offset_to_point_data, record, width, n_layers)


def _check_chunks(path: Path, offset_to_points: int) -> None:
    """Refuse a table of more chunks than the file has bytes."""
    size = path.stat().st_size
    with path.open("rb") as file:
        place = _integer(file, offset_to_points)
        if place == -1:  # written as a stream: the place is at the end
            place = _integer(file, size - 8)
        if not 0 <= place <= size - 8:
            raise ReadError(f"{path} has no table of chunks at byte {place}: it is truncated. Download it again.")
        file.seek(place + 4)  # behind the version
        n_chunks = int.from_bytes(file.read(4), "little")
    require_bytes(path, f"{n_chunks} chunks of compressed points", n_chunks, size)


@contextmanager
def _reading_laz(path: Path) -> Iterator[None]:
    """Turn errors of laz-rs, and its panics, which are no `Exception` in Python, into errors about the file.

    Raises:
        ReadError: instead of an error or a panic.
    """
    try:
        yield
    except _of_laz_rs() as error:
        raise ReadError(f"{path} could not be read by laz-rs ({summary(error)}): it is damaged.") from error


def _of_laz_rs() -> tuple[type[BaseException], ...]:
    """What the library raises; the class of panics is made with the first one, in a module that cannot be imported."""
    panics = [kind for kind in BaseException.__subclasses__() if kind.__module__ == "pyo3_runtime"]
    library = sys.modules.get("lazrs")  # laspy has imported it if it is there
    return tuple(panics) if library is None else (library.LazrsError, *panics)


def _check_layers(path: Path, offset_to_points: int, record: bytes, width: int, n_layers: int) -> None:
    """Refuse chunks that are shorter than their layers: a point, a count and the lengths of its layers come first."""
    import lazrs

    begins = width + 4
    with path.open("rb") as file:
        file.seek(offset_to_points)
        table = lazrs.read_chunk_table(file, lazrs.LazVlr(record))
        at = offset_to_points + 8
        for _, n_bytes in table:
            file.seek(at + begins)
            lengths = np.frombuffer(file.read(4 * n_layers), dtype="<u4")
            needed = begins + 4 * n_layers + int(lengths.sum(dtype=np.int64))
            require_bytes(path, f"layers of a chunk at byte {at}", needed, min(n_bytes, path.stat().st_size - at))
            at += n_bytes


def _integer(file: BinaryIO, at: int) -> int:
    file.seek(max(0, at))
    return int.from_bytes(file.read(8), "little", signed=True)
