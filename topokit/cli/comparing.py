"""The command that compares two files, or the files of two folders by name."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from topokit.batch.examine import Answer
from topokit.batch.names import name_as_data
from topokit.cli.answers import say
from topokit.cli.conditions import Condition, parse_conditions
from topokit.cli.writers import CsvWriter
from topokit.errors import InputError, Option, TopokitError
from topokit.text import json_text, printable

if TYPE_CHECKING:
    from topokit.comparison.result import Comparison
    from topokit.pages.document import Entry

_NUMBERS = tuple(
    f"{kind}{k}"
    for kind, k in product(
        ("betti_a", "betti_b", "matched", "missing", "spurious", "betti_error", "betti_matching_error"), range(3)
    )
)
COLUMNS = ("file", "label", *_NUMBERS, "dice", "error")
_FAIL_ON = "Exit with 1 if a comparison meets it, such as 'spurious1>0'. May be repeated."
_LABELS = "Compare labeled volumes label by label."


def compare(
    prediction: Annotated[Path, typer.Argument(help="What is judged: a file, or a folder of files.")],
    truth: Annotated[Path, typer.Argument(help="The truth: a file, or a folder with files of the same names.")],
    as_csv: Annotated[bool, typer.Option("--csv", help="Comma-separated values, a line per file or label.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object per line, with all places.")] = False,
    labels: Annotated[str | None, typer.Option(metavar="all|1,2,…", help=_LABELS)] = None,
    ignore: Annotated[str | None, typer.Option(help="Value of the truth that is ignored, or a file of a mask.")] = None,
    level: Annotated[float | None, typer.Option(help="Volumes: inside is above it.")] = None,
    label: Annotated[float | None, typer.Option(help="Volumes: inside are voxels of this value.")] = None,
    connectivity: Annotated[int | None, typer.Option(help="6 or 26, of both; the default of volumes is 26.")] = None,
    tolerance: Annotated[float | None, typer.Option(help="Distance of surfaces that counts as none.")] = None,
    resolution: Annotated[int, typer.Option(min=2, help="All but volumes: cells of the common grid.")] = 128,
    html: Annotated[Path | None, typer.Option(help="Write a page with a 3D view of every comparison.")] = None,
    fail_on: Annotated[list[str] | None, typer.Option(metavar="CONDITION", help=_FAIL_ON)] = None,
) -> None:
    """Which parts (0), tunnels (1) and cavities (2) match the truth, which are missing or spurious, and where."""
    if as_csv and as_json:
        raise typer.BadParameter("--csv and --json exclude each other.")
    try:
        conditions = parse_conditions(fail_on or (), _NUMBERS)
    except ValueError as error:
        raise typer.BadParameter(f"--fail-on: {error}") from error
    options: dict[str, Any] = {"connectivity": connectivity, "tolerance": tolerance, "ignore": _ignored(ignore)}
    if labels is None:
        options |= {"level": level, "label": label, "resolution": resolution}
    elif level is not None or label is not None:
        raise typer.BadParameter("--labels goes without --level and --label.")
    options = {name: value for name, value in options.items() if value is not None}
    show = _table() if as_csv else _records if as_json else _text
    has_failed = False

    def rows() -> Iterator[Entry]:
        nonlocal has_failed
        for one in _compared(prediction, truth, labels, options):
            row = one.row(with_dice=as_csv)
            show(one, row)
            has_failed |= _is_failure(row, conditions)
            if html is not None:
                yield one.entry()

    if html is None:
        deque(rows(), maxlen=0)
    else:
        from topokit.comparison.page import COLUMNS as OF_PAGE
        from topokit.pages.document import write_html

        try:
            write_html(rows(), html, title=f"{prediction.name} against {truth.name}", columns=OF_PAGE)
        except InputError as error:  # about the name of the page, before anything is compared
            raise typer.BadParameter(f"--html: {error}") from error
    raise typer.Exit(int(has_failed))


class _Pair(NamedTuple):
    """Two files or labels that were compared.

    Attributes:
        name: of both.
        found: the comparison, or why there is none.
        label: of the voxels, if one after the other was compared.
    """

    name: str
    found: Comparison | str
    label: int | None = None

    @property
    def title(self) -> str:
        """What to call it."""
        return printable(self.name) + ("" if self.label is None else f", label {self.label}")

    def row(self, *, with_dice: bool) -> dict[str, Any]:
        """Its values by `COLUMNS`."""
        if isinstance(self.found, str):
            return dict.fromkeys(COLUMNS) | {"file": self.name, "label": self.label, "error": self.found}
        numbers = {column: getattr(self.found, column[:-1])[int(column[-1])] for column in _NUMBERS}
        dice = round(self.found.agreement.dice, 6) if with_dice else None
        return {"file": self.name, "label": self.label, **numbers, "dice": dice, "error": None}

    def entry(self) -> Entry:
        """Its row in a page."""
        from topokit.comparison.page import entry_of
        from topokit.pages.document import Entry

        return Entry(self.title, None, self.found) if isinstance(self.found, str) else entry_of(self.found, self.title)


Show = Callable[[_Pair, dict[str, Any]], None]


def _table() -> Show:
    writer = CsvWriter(sys.stdout, COLUMNS)
    return lambda one, row: writer.write(Answer(row))


def _records(one: _Pair, row: dict[str, Any]) -> None:
    named = {"file": name_as_data(one.name)} | ({} if one.label is None else {"label": one.label})
    found = {"error": one.found} if isinstance(one.found, str) else one.found.to_dict()
    print(json_text(named | found), flush=True)


def _text(one: _Pair, row: dict[str, Any]) -> None:
    if not isinstance(one.found, str):
        print(one.found.text(), flush=True)


def _compared(prediction: Path, truth: Path, labels: str | None, options: dict[str, Any]) -> Iterator[_Pair]:
    """Every pair of files or labels."""
    from topokit.pairs import compare as compared
    from topokit.pairs import compare_labels, matched_files

    if prediction.is_dir() and truth.is_dir():
        try:
            pairs = list(matched_files(prediction, truth))
        except InputError as error:
            raise typer.BadParameter(str(error)) from error
    else:
        pairs = [(prediction.name, prediction, truth)]
    wanted: Any = labels if labels in (None, "all") else _numbers(labels)
    for name, one, other in pairs:
        if one is None or other is None:
            yield _Pair(name, f"{prediction if one is None else truth} has no file of this name.")
            continue
        try:
            if labels is None:
                yield _Pair(name, compared(one, other, **options))
            else:
                for number, found in compare_labels(one, other, wanted, **options).items():
                    yield _Pair(name, found, number)
        except TopokitError as error:
            yield _Pair(name, error.worded(_flag))


def _flag(option: Option) -> str:
    return f"--{option.name} {option.value or ''}".rstrip()


def _is_failure(row: dict[str, Any], conditions: list[Condition]) -> bool:
    """Whether a pair failed or meets a condition, which standard error says."""
    called = printable(row["file"]) + ("" if row["label"] is None else f", label {row['label']}")
    if row["error"] is not None:
        say(f"{called}: {row['error']}")
        return True
    if met := [one.found(row) for one in conditions if one.meets(row)]:
        say(f"{called} meets {', '.join(met)}")
    return bool(met)


def _ignored(text: str | None) -> float | str | None:
    """A number, or a path."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return text


def _numbers(labels: str | None) -> tuple[int, ...]:
    try:
        return tuple(map(int, (labels or "").split(",")))
    except ValueError as error:
        raise typer.BadParameter(f"--labels is {labels!r}; expected all, or integers with commas between.") from error
