"""Rows of a survey as a Parquet file, written while they come."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Any

from topokit.batch.examine import COLUMNS, Row
from topokit.batch.names import name_as_data
from topokit.batch.widths import NARROWEST
from topokit.errors import requiring
from topokit.inputs.writing import completed_file
from topokit.text import as_unicode

_GROUP = 4096  # rows that are held in memory, and read together later
_TEXTS = ("file", "adapter", "verdict", "reason", "error")
_FLAGS = ("closed", "manifold")
_NUMBERS = ("confidence", "resolution", "estimate", "refined", "seconds", *NARROWEST)  # all others are integers


def write_parquet(rows: Iterable[Row], path: str | os.PathLike[str], columns: Sequence[str] = COLUMNS) -> None:
    """Write rows under the names of columns, with the same types whatever is in them; None is null.

    Raises:
        MissingDependencyError: if pyarrow is not installed.
        InputError: if the file cannot be written.
    """
    with requiring('Writing Parquet needs pyarrow: pip install "topokit[cluster]".'):
        import pyarrow
        from pyarrow.parquet import ParquetWriter
    schema = pyarrow.schema([(name, _kind(pyarrow, name)) for name in columns])
    coming = map(_portable, rows)
    with completed_file(path) as unfinished, ParquetWriter(unfinished, schema) as writer:
        while group := list(islice(coming, _GROUP)):
            writer.write_table(pyarrow.Table.from_pylist(group, schema))


def _portable(row: Row) -> Row:
    texts = {name: as_unicode(row[name]) for name in _TEXTS if row[name] is not None}
    return row | texts | {"file": name_as_data(row["file"])}


def _kind(pyarrow: Any, name: str) -> Any:
    if name in _TEXTS:
        return pyarrow.string()
    if name in _FLAGS:
        return pyarrow.bool_()
    return pyarrow.float64() if name in _NUMBERS else pyarrow.int64()
