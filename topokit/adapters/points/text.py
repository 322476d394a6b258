"""Point files of text: numbers in columns, with the separators and the decimal sign found in the file."""

from __future__ import annotations

import codecs
import io
import itertools
import re
import warnings
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from topokit.adapters.points.stored_clouds import LOOKED_AT, NAMES, Block, Cloud, StoredCloud, are_normals, split
from topokit.core.arrays import Floats
from topokit.errors import ReadError
from topokit.inputs.files import head
from topokit.inputs.reading import reading

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?,?")
_COMMAS_INSIDE = re.compile(r"[-+]?\d+(,\d+)*(\.\d*)?([eE][-+]?\d+)?,?")
_SOME_ROWS = 1000  # rows from which the separators are found
_BYTES = 1 << 26  # of text that are read at once
_COLORS = 255
_ADVICE = "Write numbers with decimal points and separate them by blanks, or write decimal commas and separate by ';'."


class Layout(NamedTuple):
    """Where the rows of a table of text begin (in bytes), which of their columns are read, and what a line becomes."""

    start: int
    columns: tuple[int, ...]
    normalized: Callable[[str], str]


class TextCloud(StoredCloud):
    """Rows of numbers in a file of text."""

    def __init__(self, path: Path, layout: Layout, has_normals: bool | None = None) -> None:
        """Args: an existing file, where its columns are, and whether three of them are normals; by default if some are
        unit vectors.
        """
        size, beginning = path.stat().st_size, head(path)[layout.start :]
        per_row = len(beginning) / max(beginning.count(b"\n"), 1)
        super().__init__(path, max(1, round((size - layout.start) / per_row)), (layout.start, size), False)
        if len(layout.columns) < len(NAMES):
            layout = layout._replace(columns=layout.columns[:3])
        self._layout = layout
        if len(layout.columns) == len(NAMES):
            with reading(path, "the text reader"):
                some = read_rows(path, layout, (layout.start, layout.start + round(LOOKED_AT * per_row)))
            self.has_normals = are_normals(some[:, 3:]) if has_normals is None else has_normals

    def read(self, block: Block, most_points: int) -> Iterator[Cloud]:
        """See `StoredCloud`."""
        with reading(self.path, "the text reader"), np.errstate(all="ignore"):
            rows = read_rows(self.path, self._layout, block)
        yield np.ascontiguousarray(rows[:, :3]), np.ascontiguousarray(rows[:, 3:]) if self.has_normals else None


def text_cloud(path: Path) -> TextCloud:
    """The cloud of a file of text, by its own separators."""
    return TextCloud(path, layout_of(path))


def read_text(path: Path) -> Cloud:
    """All points of a file of text, and its normals or None."""
    return split(read_table(path), path)


def read_table(path: Path) -> Floats:
    """The numbers at the beginning of each row, as many as the first row has, at most six; see `layout_of`."""
    layout, size = layout_of(path), path.stat().st_size
    parts = [read_rows(path, layout, (at, at + _BYTES)) for at in range(layout.start, size, _BYTES)]
    return np.concatenate(parts)


def layout_of(path: Path) -> Layout:
    """How a table of text is read.

    Columns are separated by blanks, commas or semicolons. A comma inside a number is a decimal sign where blanks or
    semicolons separate ("1,5 2,5 3,5"). A header or a count line may come first; # begins a comment.

    Raises:
        ReadError: if there is no row of three numbers, or if commas may be separators or decimal signs.
    """
    beginning = head(path).decode("utf-8-sig", errors="replace").splitlines()
    normalized = _normalizer(list(itertools.islice(_rows(beginning, _commas_as_blanks), _SOME_ROWS)), path)
    at = len(codecs.BOM_UTF8) if head(path, len(codecs.BOM_UTF8)) == codecs.BOM_UTF8 else 0
    with path.open(encoding="utf-8-sig", newline="") as file:  # with line ends as they are, whose bytes count
        for line in file:
            for content in _rows([line], normalized):
                n_numbers = len(list(itertools.takewhile(_NUMBER.fullmatch, normalized(content).split())))
                return Layout(at, tuple(range(min(n_numbers, 6))), normalized)
            at += len(line.encode())
    raise ReadError(f"{path} holds no row of at least three numbers.")


def read_rows(path: Path, layout: Layout, block: tuple[int, int]) -> Floats:
    """The rows (n, c) of those lines that begin in a block of bytes, given by its first and last + 1."""
    with path.open("rb") as file:
        file.seek(block[0])
        if block[0] > layout.start:  # the rest of a line that began before
            file.seek(block[0] - 1)
            file.readline()
        content = file.read(max(0, block[1] - file.tell()))
        content += b"" if not content or content.endswith(b"\n") else file.readline()
    text = io.StringIO(layout.normalized(content.decode("utf-8")), newline=None)  # any line ends
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "loadtxt: input contained no data", UserWarning)
        return np.loadtxt(text, usecols=layout.columns, ndmin=2).reshape(-1, len(layout.columns))


def holds_rows(path: Path) -> bool:
    """Whether the beginning of a text file has a row of three numbers, as tables and prose seldom have."""
    beginning = head(path).decode("utf-8-sig", errors="replace").splitlines()
    return next(_rows(beginning, _commas_as_blanks), None) is not None


def _rows(lines: Iterable[str], normalized: Callable[[str], str]) -> Iterator[str]:
    """Lines without their comments that begin with three numbers."""
    for line in lines:
        content = line.partition("#")[0]
        words = normalized(content).split()
        if len(words) >= 3 and all(_NUMBER.fullmatch(word) for word in words[:3]):
            yield content


def _normalizer(rows: list[str], path: Path) -> Callable[[str], str]:
    """What turns a line into numbers with decimal points, separated by blanks.

    Raises:
        ReadError: if that is ambiguous.
    """
    with_commas = [fields for fields in map(_fields, rows) if _has_commas_inside(fields)]
    if not with_commas:
        _refuse_pairs_of_integers(rows, path)
        return _commas_as_blanks
    for fields in with_commas:
        if not all(_DECIMAL_COMMA.fullmatch(field) or field.strip(",").lstrip("+-").isdigit() for field in fields):
            raise ReadError(
                f"{path}: in {' '.join(fields)!r} the commas may be decimal signs, thousands separators or column "
                f"separators. {_ADVICE}"
            )
    return _commas_as_points


def _fields(row: str) -> list[str]:
    """The first three columns if commas do not separate."""
    return re.split(r"[;\s]+", row.strip(" \t\r\n;"))[:3]


def _has_commas_inside(fields: list[str]) -> bool:
    numbers = len(fields) == 3 and all(_COMMAS_INSIDE.fullmatch(f) or _DECIMAL_COMMA.fullmatch(f) for f in fields)
    return numbers and any("," in field.strip(",") for field in fields)


def _refuse_pairs_of_integers(rows: list[str], path: Path) -> None:
    """Refuse "0,188817,0,5,0,25": three numbers with decimal commas, or six integers that are no colors."""
    for row in rows:
        columns = [column.strip() for column in row.strip(" \t\r\n,").split(",")]
        if len(columns) < 6 or len(columns) % 2 or not all(column.lstrip("+-").isdigit() for column in columns):
            return
        fractions = columns[1::2]
        are_colors = all(0 <= int(column) <= _COLORS for column in columns[3:6])
        if any(column.startswith("0") and len(column) > 1 for column in fractions) or not are_colors:
            raise ReadError(
                f"{path}: {row.strip()!r} may be {len(columns)} integers or {len(columns) // 2} numbers with decimal "
                f"commas. {_ADVICE}"
            )


def _commas_as_blanks(line: str) -> str:
    return line.replace(",", " ").replace(";", " ")


def _commas_as_points(line: str) -> str:
    return re.sub(r",(?=\s|$)|;", " ", line).replace(",", ".")
