"""Parquet tables with columns x, y, z and perhaps nx, ny, nz, read by groups of rows."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from topokit.adapters.points.stored_clouds import Block, Cloud, StoredCloud
from topokit.core.arrays import Floats
from topokit.errors import ReadError, requiring
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import require_expansion

_COORDINATES, _NORMALS = ("x", "y", "z"), ("nx", "ny", "nz")
_BYTES = 4  # of a coordinate at least, once it is unpacked


class ParquetCloud(StoredCloud):
    """The rows of a table, whatever the case of its column names."""

    def __init__(self, path: Path) -> None:
        """Args: an existing file.

        Raises:
            ReadError: if it is damaged, or has other columns.
            MissingDependencyError: if pyarrow is not installed.
        """
        with _opened(path) as file:
            names = {name.lower(): name for name in file.schema_arrow.names}
            if not names.keys() >= set(_COORDINATES):
                raise ReadError(
                    f"{path} has the columns {', '.join(file.schema_arrow.names)}; x, y and z were expected."
                )
            n_rows, groups = file.metadata.num_rows, (0, file.metadata.num_row_groups)
        require_expansion(path, 3 * _BYTES * n_rows, path.stat().st_size)
        has_normals = names.keys() >= set(_NORMALS)
        self._columns = [names[name] for name in (*_COORDINATES, *(_NORMALS if has_normals else ()))]
        super().__init__(path, n_rows, groups, has_normals)

    def read(self, block: Block, most_points: int) -> Iterator[Cloud]:
        """See `StoredCloud`; what is missing in a table is NaN."""
        with _opened(self.path) as file:
            for batch in file.iter_batches(most_points, row_groups=range(*block), columns=self._columns):
                table = np.stack([_numbers(batch.column(name)) for name in self._columns], axis=1)
                normals = np.ascontiguousarray(table[:, 3:]) if self.has_normals else None
                yield np.ascontiguousarray(table[:, :3]), normals


def _numbers(column: Any) -> Floats:
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """pyarrow's reader of a file; its errors are errors about the file."""
    with requiring('Reading .parquet needs pyarrow: pip install "topokit[formats]".'):
        from pyarrow import ArrowException
        from pyarrow.parquet import ParquetFile
    with reading(path, "pyarrow", ArrowException), path.open("rb") as stream, ParquetFile(stream) as file:
        yield file
