"""The forms of results, with an option for each: texts, a table, JSON, JSON lines or CSV, written as they are known."""

from __future__ import annotations

import csv
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal, TextIO

import typer

from topokit.batch.examine import COLUMNS, Answer, Row
from topokit.batch.names import name_as_data
from topokit.cli.encoding import carries_all
from topokit.text import json_text, printable

Form = Literal["text", "table", "json", "jsonl", "csv"]
Record = Callable[[Answer], Mapping[str, Any]]  # an answer as an object for JSON
Text = Callable[[Answer], str]

# Where a cell begins that a spreadsheet computes, also one that takes semicolons for commas; a hyphen alone is a text.
_FORMULA = re.compile("(^|;)(?=[=+@\uff1d\uff0b\uff0d\uff20-].)")


class Writer(ABC):
    """Writes answers to a stream.

    Attributes:
        is_ordered: whether it is to be given the answers in the order of the files, instead of as they are known.
    """

    is_ordered = True

    @abstractmethod
    def write(self, answer: Answer) -> None:
        """Write one answer."""

    def close(self) -> None:  # noqa: B027  (most forms have no end)
        """Write what comes after the last one."""


class TextWriter(Writer):
    """Texts of the shapes that could be examined."""

    def __init__(self, stream: TextIO, text: Text) -> None:
        self._stream, self._text = stream, text

    def write(self, answer: Answer) -> None:
        """See `Writer`."""
        if answer.error is None:
            print(self._text(answer), file=self._stream, flush=True)


class TableWriter(Writer):
    """Aligned rows."""

    def __init__(self, stream: TextIO, names: Sequence[str], further: Sequence[str] = ()) -> None:
        from topokit.cli.table import Table

        self._table = Table(stream, names, further)

    def write(self, answer: Answer) -> None:
        """See `Writer`."""
        self._table.write(answer.row)


class JsonWriter(Writer):
    """One array, written element by element: it is complete even after an interrupt."""

    def __init__(self, stream: TextIO, record: Record) -> None:
        self._stream, self._record = stream, record
        self._separator = "\n"
        stream.write("[")

    def write(self, answer: Answer) -> None:
        """See `Writer`."""
        lines = _json(self._record(answer), self._stream, indent=2).split("\n")
        text = self._separator + "\n".join(f"  {line}" for line in lines)
        self._separator = ",\n"  # set first, since an interrupt may come while the text is flushed
        self._stream.write(text)
        self._stream.flush()

    def close(self) -> None:
        """See `Writer`."""
        self._stream.write("\n]\n")
        self._stream.flush()


class JsonLinesWriter(Writer):
    """One object per line."""

    is_ordered = False

    def __init__(self, stream: TextIO, record: Record) -> None:
        self._stream, self._record = stream, record

    def write(self, answer: Answer) -> None:
        """See `Writer`."""
        print(_json(self._record(answer), self._stream), file=self._stream, flush=True)


class CsvWriter(Writer):
    """One line per shape below a line with the names of the columns."""

    def __init__(self, stream: TextIO, columns: Sequence[str] = COLUMNS) -> None:
        self._stream = stream
        self._writer = csv.DictWriter(stream, columns, lineterminator="\n")
        self._writer.writeheader()

    def write(self, answer: Answer) -> None:
        """See `Writer`."""
        self._writer.writerow(_cells(answer.row))
        self._stream.flush()


def _json(record: Mapping[str, Any], stream: TextIO, indent: int | None = None) -> str:
    """JSON text; escaped where the stream's encoding lacks letters, so that nothing is lost."""
    return json_text(record, indent=indent, ascii=not carries_all(stream.encoding))


def _cells(row: Row) -> dict[str, Any]:
    """The row with texts that no spreadsheet computes and no terminal obeys, and a name by which the file is found."""
    texts = {name: _FORMULA.sub(r"\1'", printable(value)) for name, value in row.items() if isinstance(value, str)}
    return row | texts | {"file": name_as_data(row["file"], _is_cell)}


def _is_cell(name: str) -> bool:
    return printable(name) == name and not _FORMULA.search(name)


@dataclass(frozen=True)
class JsonForms:
    """Forms of numbers, of which one may be chosen."""

    json: Annotated[bool, typer.Option("--json", help="One JSON array, an object per shape.")] = False
    jsonl: Annotated[bool, typer.Option("--jsonl", help="One JSON object per line.")] = False

    def __post_init__(self) -> None:
        if len(wanted := self._wanted) > 1:
            raise typer.BadParameter(f"{' and '.join(f'--{form}' for form in wanted)} exclude each other.")

    @property
    def chosen(self) -> Form | None:
        """The form that is asked for, if there is one."""
        return next(iter(self._wanted), None)

    @property
    def _wanted(self) -> list[Any]:
        return [one.name for one in fields(self) if getattr(self, one.name)]


_TABLE = "One aligned row per shape; the default on a terminal if there are several."


@dataclass(frozen=True)
class Forms(JsonForms):
    """Forms of reports, of which one may be chosen."""

    text: Annotated[bool, typer.Option("--text", help="The whole report of every shape.")] = False
    table: Annotated[bool, typer.Option("--table", help=_TABLE)] = False
    csv: Annotated[bool, typer.Option("--csv", help="Comma-separated values, a line per shape.")] = False
