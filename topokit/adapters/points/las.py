"""LAS, and compressed LAZ if laspy has a backend for it: any part of the points, for which only its bytes are read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from topokit.adapters.points.laz import check_packing, reading_laz
from topokit.adapters.points.stored import Block, Cloud, StoredCloud
from topokit.errors import MissingDependencyError, ReadError
from topokit.inputs.files import head
from topokit.inputs.reading import reading, require_bytes, require_expansion

_INSTALL = 'pip install "topokit[formats]"'


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
                check_packing(path, header)
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
    try:
        import laspy
    except ImportError as error:
        raise MissingDependencyError(f"Reading .las needs laspy: {_INSTALL}.") from error
    damaged = (laspy.errors.LaspyException, AssertionError, LookupError, TypeError)
    with reading_laz(path), reading(path, "laspy", *damaged), laspy.open(path, read_evlrs=False) as file:
        if file.header.are_points_compressed and not laspy.LazBackend.detect_available():
            raise MissingDependencyError("Reading .laz needs a backend of laspy: pip install lazrs.")
        yield file
