"""Files of points that can be read block by block: PLY, LAS and LAZ, parquet, .npy as a memory map, and text."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from topokit.adapters.points.entry import LAS, PARQUET, TEXT
from topokit.adapters.points.las import LasCloud
from topokit.adapters.points.parquet import ParquetCloud
from topokit.adapters.points.stored import LOOKED_AT, Block, Cloud, MappedCloud, StoredCloud, are_normals
from topokit.adapters.points.text import Layout, layout_of, read_rows
from topokit.inputs.files import head
from topokit.inputs.numpy_header import NUMPY, array_shapes
from topokit.inputs.ply import check_header, ply_elements
from topokit.inputs.reading import reading

_NAMES = ("x", "y", "z", "nx", "ny", "nz")


class TextCloud(StoredCloud):
    """Rows of numbers in a file of text."""

    def __init__(self, path: Path, layout: Layout, has_normals: bool | None = None) -> None:
        """Args: an existing file, where its columns are, and whether three of them are normals; by default if some are
        unit vectors.
        """
        size, beginning = path.stat().st_size, head(path)[layout.start :]
        per_row = len(beginning) / max(beginning.count(b"\n"), 1)
        super().__init__(path, max(1, round((size - layout.start) / per_row)), (layout.start, size), False)
        if len(layout.columns) < len(_NAMES):
            layout = layout._replace(columns=layout.columns[:3])
        self._layout = layout
        if len(layout.columns) == len(_NAMES):
            with reading(path, "the text reader"):
                some = read_rows(path, layout, (layout.start, layout.start + round(LOOKED_AT * per_row)))
            self.has_normals = are_normals(some[:, 3:]) if has_normals is None else has_normals

    def read(self, block: Block, most_points: int) -> Iterator[Cloud]:
        """See `StoredCloud`."""
        with reading(self.path, "the text reader"), np.errstate(all="ignore"):
            rows = read_rows(self.path, self._layout, block)
        yield np.ascontiguousarray(rows[:, :3]), np.ascontiguousarray(rows[:, 3:]) if self.has_normals else None


def stored_file(path: Path) -> StoredCloud | None:
    """The cloud of an existing file, to be read block by block; None if other readers read it, as a whole.

    Raises:
        ReadError: if the file is malformed.
        MissingDependencyError: if the package for its format is not installed.
    """
    with path.open("rb") as file:
        start = file.read(len(NUMPY))  # of a gzip file its own: that is read as a whole
    if start.startswith(LAS):
        return LasCloud(path)
    if start.startswith(PARQUET):
        return ParquetCloud(path)
    if start.startswith(b"ply"):
        return _ply_cloud(path)
    if start.startswith(NUMPY):
        if len(array_shapes(path).get("", ())) != 2:
            return None
        with reading(path, "the NumPy reader"):
            mapped = np.load(path, mmap_mode="r", allow_pickle=False)
        return MappedCloud(mapped)
    return TextCloud(path, layout_of(path)) if path.suffix.lower() in TEXT else None


def _ply_cloud(path: Path) -> StoredCloud | None:
    """A file whose vertices are records of numbers; text only if there is nothing else in it."""
    header = check_header(path)
    counts = {name: int(n) for name, n in re.findall(rb"^element\s+(\S+)\s+(\d+)", header, re.MULTILINE)}
    if not counts.get(b"vertex") or b"property list" in header:
        return None
    if b"format ascii" not in header:
        mapped = ply_elements(path)["vertex"]
        names = _columns(list(mapped.dtype.names or ()))
        if names is None or not isinstance(mapped, np.memmap) or str(mapped.filename) != os.path.abspath(path):
            return None
        return MappedCloud(mapped, names)
    names = _columns([name.decode("latin-1") for name in re.findall(rb"^property\s+\w+\s+(\S+)", header, re.MULTILINE)])
    if sum(counts.values()) > counts[b"vertex"] or names is None:
        return None
    every = re.findall(rb"^property\s+\w+\s+(\S+)", header, re.MULTILINE)
    columns = tuple(every.index(name.encode()) for name in names)
    return TextCloud(path, Layout(len(header), columns, str), len(names) == len(_NAMES))


def _columns(names: list[str]) -> tuple[str, ...] | None:
    """The fields of coordinates, and of normals if there are all; None if there are no coordinates."""
    if not set(_NAMES[:3]) <= set(names):
        return None
    return _NAMES if set(_NAMES) <= set(names) else _NAMES[:3]
