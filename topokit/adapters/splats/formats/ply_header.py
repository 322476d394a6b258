"""The header of a .ply file: elements, their properties, and where the data begins."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from topokit.errors import ReadError
from topokit.inputs.files import head

_LONGEST = 1 << 18  # bytes; 3DGS headers have about 1 500
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"half": "f2", "float": "f4", "double": "f8", "float16": "f2", "float32": "f4", "float64": "f8"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
}
_ENDIAN = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "="}


@dataclass(frozen=True)
class PlyElement:
    """One element: name, number of rows, type of a row's plain properties, and whether it also holds lists."""

    name: str
    count: int
    row: np.dtype[np.void]
    has_lists: bool


@dataclass(frozen=True)
class PlyHeader:
    """A parsed header.

    Attributes:
        elements: in file order.
        is_ascii: whether the data are text.
        start: byte at which the data begin.
    """

    elements: tuple[PlyElement, ...]
    is_ascii: bool
    start: int

    def __getitem__(self, name: str) -> PlyElement | None:
        return next((element for element in self.elements if element.name == name), None)

    def names(self, element: str) -> frozenset[str]:
        """Plain properties of an element; empty if it is absent or holds lists."""
        found = self[element]
        return frozenset() if found is None or found.has_lists else frozenset(found.row.names or ())

    def offset(self, name: str, path: Path) -> int:
        """Byte at which a binary element begins.

        Raises:
            ReadError: if an element with lists, whose length is unknown, comes before it.
        """
        start = self.start
        for element in self.elements:
            if element.name == name:
                return start
            if element.has_lists:
                raise ReadError(f"{path}: element {element.name!r} with lists comes before {name!r}; not supported.")
            start += element.count * element.row.itemsize
        raise ReadError(f"{path} has no element {name!r}.")


def read_ply_header(path: Path) -> PlyHeader:
    """Parse the header of a .ply file.

    Raises:
        ReadError: if it is malformed or not closed by `end_header`.
    """
    text, end, _ = head(path, _LONGEST).partition(b"end_header")
    if not end or not text.startswith(b"ply"):
        raise ReadError(f"{path} has no complete .ply header: it is truncated or not a .ply file.")
    start = len(text) + len(end)
    start += 2 if head(path, start + 2)[start:] == b"\r\n" else 1
    lines = [line.split() for line in text.decode("latin-1").splitlines()]
    endian = next((line[1] for line in lines if line[:1] == ["format"] and len(line) > 1), "missing")
    if endian not in _ENDIAN:
        raise ReadError(f"{path}: the .ply format line is {endian!r}; expected one of {', '.join(_ENDIAN)}.")
    return PlyHeader(_elements(lines, _ENDIAN[endian], path), endian == "ascii", start)


def _elements(lines: list[list[str]], endian: str, path: Path) -> tuple[PlyElement, ...]:
    found: list[tuple[str, int, dict[str, str], list[str]]] = []
    for line in lines:
        if line[:1] == ["element"] and len(line) == 3 and line[2].isascii() and line[2].isdigit():
            found.append((line[1], int(line[2]), {}, []))
            continue
        if line[:1] not in (["element"], ["property"]):
            continue
        if line[0] == "element" or len(line) < 3 or not found:
            raise ReadError(f"{path}: the .ply header line {' '.join(line)!r} is not understood.")
        _, _, fields, lists = found[-1]
        if line[1] == "list":
            lists.append(line[-1])
        elif len(line) == 3 and line[1] in _TYPES and line[2] not in fields:
            fields[line[2]] = endian + _TYPES[line[1]]
        else:
            raise ReadError(f"{path}: the .ply header line {' '.join(line)!r} is not understood.")
    return tuple(
        PlyElement(name, count, np.dtype(list(fields.items())), bool(lists)) for name, count, fields, lists in found
    )
