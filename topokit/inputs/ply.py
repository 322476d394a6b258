"""PLY files in and out, through plyfile."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from topokit.errors import InputError, ReadError
from topokit.inputs.files import head
from topokit.inputs.reading import reading
from topokit.inputs.size_limits import require_bytes
from topokit.inputs.writing import completed_file

_LONGEST_HEADER = 1 << 18  # bytes; a 3DGS header has about 1 500
_HALF = re.compile(rb"^property[ \t]+(?:half|float16)[ \t]+", re.MULTILINE)
_HALF_MARK = "half:"


def ply_elements(
    path: Path, list_lengths: Mapping[str, Mapping[str, int]] = MappingProxyType({})
) -> dict[str, NDArray[np.void]]:
    """The elements of a .ply file by name, as structured arrays in the byte order of the file.

    Binary elements without lists are memory-mapped. Half floats are read too, although neither the format nor plyfile
    knows them: some splat trainers write them.

    Args:
        path: an existing file.
        list_lengths: by element and name of a list its probable length: where all rows have it, the element is
            memory-mapped, too, and the list is an array; else it is an array of arrays.

    Raises:
        ReadError: if the file is malformed, or shorter than its header announces.
    """
    from plyfile import PlyParseError

    guard = reading(path, "plyfile", PlyParseError)
    with guard, _readable(path, check_header(path)) as file, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "loadtxt: input contained no data", UserWarning)  # of empty lists
        elements = _elements(file, list_lengths)
    return {element.name: _with_halves(element.data) for element in elements}


def _elements(file: BinaryIO, list_lengths: Mapping[str, Mapping[str, int]]) -> Any:
    from plyfile import PlyData, PlyElementParseError

    if list_lengths:
        try:
            return PlyData.read(file, mmap="r", known_list_len=list_lengths).elements
        except PlyElementParseError:  # some rows have another length, which is found row by row
            file.seek(0)
    return PlyData.read(file, mmap="r").elements


def write_ply(path: str | os.PathLike[str], **elements: NDArray[Any]) -> None:
    """Write structured arrays as a binary little-endian .ply file; a field with a shape becomes a list.

    Raises:
        InputError: if the file is not called .ply, its folder does not exist, or it cannot be written.
    """
    from plyfile import PlyData, PlyElement

    target = Path(path)
    if target.suffix.lower() != ".ply":
        raise InputError(f"{target} does not end with .ply, and PLY is what is written: rename it.")
    if not target.parent.is_dir():
        raise InputError(f"the folder of {target} does not exist: create it first.")
    described = [PlyElement.describe(table, name) for name, table in elements.items()]
    with completed_file(target) as unfinished:
        PlyData(described, byte_order="<").write(str(unfinished))


def check_header(path: Path) -> bytes:
    """The header of a .ply file with the line that ends it.

    Raises:
        ReadError: if it is incomplete, or an element in it has more rows than the file has bytes, or a file of text
            has fewer lines than rows.
    """
    found = re.match(rb"ply\s.*?^end_header(?:\r\n|\r|\n)", head(path, _LONGEST_HEADER), re.DOTALL | re.MULTILINE)
    if found is None:
        raise ReadError(f"{path} has no complete .ply header: it is truncated or not a .ply file.")
    header, n_rows = found.group(), 0
    for name, count in re.findall(rb"^element\s+(\S+)\s+(\d+)", header, re.MULTILINE):
        what = f"{int(count)} rows of element {name.decode('latin-1')!r}"
        require_bytes(path, what, int(count), path.stat().st_size - len(header))
        n_rows += int(count)
    if b"format ascii" in header and (n_lines := _count_lines(path) - len(header.splitlines())) < n_rows:
        raise ReadError(f"{path} announces {n_rows} rows and has {n_lines} lines for them: it is truncated.")
    return header


def _count_lines(path: Path) -> int:
    with path.open("rb") as file:
        return sum(1 for _ in file)


@contextmanager
def _readable(path: Path, header: bytes) -> Iterator[BinaryIO]:
    """The file, or a temporary copy with a header that plyfile accepts: ASCII, half floats marked as integers."""
    mark = b"property float " if b"format ascii" in header else f"property ushort {_HALF_MARK}".encode()
    accepted = _HALF.sub(mark, header.decode("ascii", "replace").encode("ascii", "replace"))
    with path.open("rb") as file:
        if accepted == header:
            yield file
            return
        with tempfile.TemporaryFile() as copy:
            copy.write(accepted)
            file.seek(len(header))
            shutil.copyfileobj(file, copy)
            copy.seek(0)
            yield copy


def _with_halves(rows: NDArray[np.void]) -> NDArray[np.void]:
    """The same memory, with marked 16-bit integers as the half floats that they are."""
    if not any(name.startswith(_HALF_MARK) for name in rows.dtype.names or ()):
        return rows
    kinds = {name: rows.dtype[name].str for name in rows.dtype.names or ()}
    fields = [
        (name.removeprefix(_HALF_MARK), kind.replace("u2", "f2") if name.startswith(_HALF_MARK) else kind)
        for name, kind in kinds.items()
    ]
    return rows.view(np.dtype(fields))
