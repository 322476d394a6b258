"""A table of results: one aligned row per shape, written as soon as it is known, in color where the terminal has it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

from topokit.batch.examine import Row, called
from topokit.text import printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text


class _Column(NamedTuple):
    name: str
    title: str
    width: int
    is_number: bool = True


_COLUMNS = (  # beside the file's name, the most wanted first: a narrow terminal shows only the first ones
    _Column("verdict", "verdict", 7, False),
    _Column("euler", "euler", 7),
    _Column("genus", "genus", 5),
    _Column("components", "components", 10),
    _Column("closed", "closed", 6, False),
    _Column("boundary_loops", "loops", 5),
    _Column("pieces", "pieces", 6),
    _Column("tunnels", "tunnels", 7),
    _Column("cavities", "cavities", 8),
    _Column("seconds", "seconds", 7),
)
_NARROWEST = 20  # letters of a file's name; if columns leave less, the last ones are left out
_STYLES = {"certain": "green", "likely": "cyan", "unsure": "yellow", "failed": "bold red"}
_GAP = "  "


class Table:
    """Writes rows to a stream."""

    def __init__(self, stream: TextIO, names: Sequence[str], further: Sequence[str] = ()) -> None:
        """Args: where to write, the names in the first column, which make its width, and columns of widths."""
        from rich.cells import cell_len
        from rich.console import Console

        self._console: Console = Console(file=stream, highlight=False)
        longest = max(map(cell_len, ("file", *map(printable, names))))
        room = self._console.width if self._console.is_terminal else sys.maxsize
        self._columns = _fitting(_columns(further), room - min(longest, _NARROWEST))
        self._name_width = min(longest, room - _width(self._columns))
        self._has_title = False

    def write(self, row: Row) -> None:
        """Write one row, the first time below the titles."""
        if not self._has_title:
            titles = self._line("file", {column.name: column.title for column in self._columns})
            titles.stylize("bold")
            self._print(titles)
            self._has_title = True
        self._print(self._line(printable(called(row)), {column.name: _cell(row, column) for column in self._columns}))

    def _line(self, name: str, cells: dict[str, str]) -> Text:
        from rich.text import Text

        line = Text(_shortened(name, self._name_width))
        for column in self._columns:
            cell = cells[column.name]
            padded = cell.rjust(column.width) if column.is_number else cell.ljust(column.width)
            line.append(_GAP).append(padded, style=_STYLES.get(cell, ""))
        line.rstrip()
        return line

    def _print(self, line: Text) -> None:
        self._console.print(line, soft_wrap=True)


def _columns(further: Sequence[str]) -> tuple[_Column, ...]:
    """Those of every table, with further ones behind the verdict, χ and genus."""
    added = (_Column(name, name.replace("_", " "), len(name)) for name in further)
    return (*_COLUMNS[:3], *added, *_COLUMNS[3:])


def _fitting(columns: Sequence[_Column], room: int) -> Sequence[_Column]:
    """As many of the first columns as fit, but at least the verdict."""
    fitting = [n for n in range(1, len(columns) + 1) if _width(columns[:n]) <= room]
    return columns[: max(fitting, default=1)]


def _width(columns: Sequence[_Column]) -> int:
    return sum(len(_GAP) + column.width for column in columns)


def _cell(row: Row, column: _Column) -> str:
    value: Any = row.get(column.name)  # a file that failed has no widths
    if column.name == "verdict":
        return value or "failed"
    if column.name == "seconds":
        return "" if value is None else f"{value:.2f}"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    return ("" if row["error"] else "?") if value is None else str(value)


def _shortened(name: str, width: int) -> str:
    """The end of a name that is too long, or the name with blanks up to this width."""
    from rich.cells import cell_len, set_cell_size

    if cell_len(name) <= width:
        return set_cell_size(name, width)
    start = next(i for i in range(1, len(name) + 1) if cell_len(name[i:]) < width)
    return set_cell_size("…" + name[start:], width)
