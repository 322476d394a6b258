"""Clouds that stay where they are stored, and are read block by block: memory maps, and what other modules add.

All of these can be sent to other processes, which then read for themselves.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from topokit.core.arrays import Floats
from topokit.errors import InputError, ReadError
from topokit.inputs.reading import reading

Cloud = tuple[Floats, Floats | None]
Block = tuple[int, int]

NAMES = ("x", "y", "z", "nx", "ny", "nz")
LOOKED_AT = 1 << 16  # rows at the beginning that tell whether columns without names are normals
_AT_ONCE = 1 << 20  # points, where a whole cloud is read
_WIDTHS = "(N, 3) for points or (N, 6) for points and normals"


class StoredCloud(ABC):
    """A cloud that is read block by block.

    Attributes:
        path: of its file.
        n_points: how many points it has; of text about how many.
        has_normals: whether `read` gives normals.
    """

    def __init__(self, path: Path, n_points: int, units: Block, has_normals: bool) -> None:
        """Args: see the class; units are where points begin and end in the file: rows, bytes or groups of rows."""
        self.path, self.n_points, self.has_normals, self._units = path.absolute(), n_points, has_normals, units

    def blocks(self, most_points: int) -> list[Block]:
        """The file as blocks of about so many points."""
        start, stop = self._units
        step = max(1, most_points * (stop - start) // max(self.n_points, 1))
        return [(first, min(first + step, stop)) for first in range(start, stop, step)]

    @abstractmethod
    def read(self, block: Block, most_points: int) -> Iterator[Cloud]:
        """The points (n, 3) and normals (n, 3) or None of a block, not many more than so many at once.

        Raises:
            ReadError: if the file is damaged there.
        """


class MappedCloud(StoredCloud):
    """Rows of equal length in a binary file: an array of two axes, or records with named fields."""

    def __init__(self, mapped: np.memmap[Any, Any], columns: Sequence[str] | None = None) -> None:
        """Args: a memory map that is no slice of another one; names of three fields, or six, of its records.

        Raises:
            ReadError: if the array has other axes.
            InputError: if it holds no real numbers.
        """
        self._dtype, self._offset, self._shape = mapped.dtype, mapped.offset, mapped.shape
        self._order, self._columns = (
            "F" if mapped.flags.f_contiguous and not mapped.flags.c_contiguous else "C",
            columns,
        )
        path = Path(str(mapped.filename))
        if columns is None and mapped.dtype.kind not in "biuf":
            raise InputError(f"{path} holds an array of {mapped.dtype}; real numbers were expected.", file=path)
        if columns is None and (mapped.ndim != 2 or mapped.shape[1] < 3):
            raise ReadError(f"{path} has shape {mapped.shape}; {_WIDTHS} was expected.")
        super().__init__(path, len(mapped), (0, len(mapped)), False)
        some = self._rows((0, min(LOOKED_AT, len(mapped))))
        self.has_normals = some.shape[1] == 6 and (columns is not None or are_normals(some[:, 3:]))

    def read(self, block: Block, most_points: int) -> Iterator[Cloud]:
        """See `StoredCloud`."""
        rows = self._rows(block)
        yield np.ascontiguousarray(rows[:, :3]), np.ascontiguousarray(rows[:, 3:]) if self.has_normals else None

    def _rows(self, block: Block) -> Floats:
        """Three columns or six; mapped anew each time, so that what was read does not stay in memory."""
        with reading(self.path, "the NumPy reader"):
            order: Any = self._order
            table = np.memmap(self.path, self._dtype, "r", self._offset, self._shape, order)[slice(*block)]
            if self._columns is None:
                return np.array(table[:, : 6 if table.shape[1] >= 6 else 3], dtype=np.float64)
            return np.stack([table[name] for name in self._columns], axis=1).astype(np.float64)


def whole(cloud: StoredCloud) -> Cloud:
    """All points and normals of a cloud."""
    parts = list(cloud.read(cloud.blocks(max(cloud.n_points, 1))[0], _AT_ONCE)) if cloud.n_points else []
    points = np.concatenate([np.empty((0, 3)), *(part for part, _ in parts)])
    return points, np.concatenate([part for _, part in parts if part is not None]) if cloud.has_normals else None


def are_normals(columns: Floats) -> bool:
    """Unit vectors (to 10 %) or zeros: columns 4 to 6 may also be colors."""
    lengths = np.linalg.norm(columns[np.isfinite(columns).all(axis=1)], axis=1)
    return len(lengths) > 0 and bool((((lengths > 0.9) & (lengths < 1.1)) | (lengths == 0)).mean() > 0.9)


def split(table: Floats, path: Path) -> Cloud:
    """Columns x y z, or x y z nx ny nz; further columns (color, intensity) are ignored.

    Raises:
        ReadError: if there are fewer.
    """
    if table.ndim != 2 or table.shape[1] < 3:
        raise ReadError(f"{path} has shape {table.shape}; {_WIDTHS} was expected.")
    has_normals = table.shape[1] >= 6 and are_normals(table[:, 3:6])
    return np.ascontiguousarray(table[:, :3]), np.ascontiguousarray(table[:, 3:6]) if has_normals else None
