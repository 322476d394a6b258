"""The command that compares two files, or the files of two folders by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TextIO

import typer

from topokit.batch.dispatch import ask_each
from topokit.batch.examine import Answer
from topokit.batch.journal import Journal, Record, plain_options, stamps_of
from topokit.batch.names import name_as_data
from topokit.batch.sources import Source, Sources
from topokit.cli.answers import Coming, answer_sources, names_on_terminal
from topokit.cli.bundle import takes_bundles
from topokit.cli.conditions import Condition, parse_conditions
from topokit.cli.request import Output, Resume, Work
from topokit.cli.writers import CsvWriter, Form, JsonForms, JsonLinesWriter, JsonWriter, TextWriter, Writer
from topokit.errors import InputError, Option, TopokitError
from topokit.pairs.files import (
    COLUMNS,
    NUMBERS,
    PairAnswer,
    PairQuestions,
    after_death,
    compare_files,
    matched_files,
    numbers_of,
)

Matching = Literal["invariant", "betti-matching"]  # as in comparison.result, which the command loads only when it runs
_FAIL_ON = "Exit with 1 if a comparison meets it, such as 'spurious1>0'. May be repeated."


@dataclass(frozen=True)
class PairWork(Work):
    """How to compare many pairs of files."""

    fail_on: Annotated[list[str] | None, typer.Option(metavar="CONDITION", help=_FAIL_ON)] = None

    def _parsed(self, texts: Sequence[str]) -> list[Condition]:
        return parse_conditions(texts, NUMBERS)


@dataclass(frozen=True)
class PairForms(JsonForms):
    """Forms of comparisons, of which one may be chosen."""

    csv: Annotated[bool, typer.Option("--csv", help="Comma-separated values, a line per pair or label.")] = False


@takes_bundles
def compare(
    prediction: Annotated[Path, typer.Argument(help="What is judged: a file, or a folder of files.")],
    truth: Annotated[Path, typer.Argument(help="The truth: a file, or a folder with files of the same names.")],
    forms: PairForms,
    work: PairWork,
    ignore: Annotated[str | None, typer.Option(help="Value of the truth that is ignored, or a file of a mask.")] = None,
    level: Annotated[float | None, typer.Option(help="Volumes: inside is above it.")] = None,
    label: Annotated[float | None, typer.Option(help="Volumes: inside are voxels of this value.")] = None,
    connectivity: Annotated[int | None, typer.Option(help="6 or 26, of both; the default of volumes is 26.")] = None,
    matching: Annotated[
        Matching, typer.Option(help="How features are matched; betti-matching depends on the grid's orientation.")
    ] = "invariant",
    tolerance: Annotated[float | None, typer.Option(help="Distance of surfaces that counts as none.")] = None,
    resolution: Annotated[int, typer.Option(min=2, help="All but volumes: cells of the common grid.")] = 128,
    output: Output = None,
    resume: Resume = False,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="With --resume: compare those pairs again that failed.")
    ] = False,
    html: Annotated[Path | None, typer.Option(help="Write a page with a 3D view of every comparison.")] = None,
) -> None:
    """Which parts (0), tunnels (1) and cavities (2) match the truth, which are missing or spurious, and where."""
    options: dict[str, Any] = {"connectivity": connectivity, "tolerance": tolerance, "ignore": _ignored(ignore)}
    options |= {} if matching == "invariant" else {"matching": matching}
    if work.labels is None:
        options |= {"level": level, "label": label, "resolution": resolution}
    elif level is not None or label is not None:
        raise typer.BadParameter("--labels goes without --level and --label.")
    if resume and (output is None or forms.chosen != "jsonl" or html is not None):
        raise typer.BadParameter("--resume goes with -o and --jsonl, and without --html.")
    if retry_failed and not resume:
        raise typer.BadParameter("--retry-failed goes with --resume.")
    options = {name: value for name, value in options.items() if value is not None}
    form, found = forms.chosen, _found(prediction, truth)
    asked = PairQuestions(
        work.chosen_labels,
        options,
        "text" if form is None else None if form == "csv" else "record",
        html is not None,
        _worded,
    )
    several = work.labels is not None
    lines = Journal(
        output or Path(), plain_options(None, options, labels=work.chosen_labels), several=several, retries=retry_failed
    )

    def compared(left: Sequence[Source]) -> Coming:
        return ask_each(partial(compare_files, questions=asked), left, work.n_jobs, after_death, work.limits)

    has_failed = answer_sources(
        found,
        compared,
        work,
        lambda stream, left: _writer(stream, left, form, lines if output is not None else None),
        output=output,
        resume=lines if resume else None,
        row_of=_row_of,
        html=html,
        about_page=None if html is None else _about_page(prediction, truth),
        names_for_bar=names_on_terminal,
    )
    raise typer.Exit(int(has_failed))


def _found(prediction: Path, truth: Path) -> Sources:
    """The pairs of two folders, or two files."""
    if not (prediction.is_dir() and truth.is_dir()):
        return Sources((Source(prediction, prediction.name, beside=(truth,)),), ())
    try:
        return Sources(matched_files(prediction, truth), ())
    except InputError as error:
        raise typer.BadParameter(str(error)) from error


def _writer(stream: TextIO, found: Sources, form: Form | None, journal: Journal | None) -> Writer:
    if form == "csv":
        return CsvWriter(stream, COLUMNS)
    if form == "json":
        return JsonWriter(stream, _record)
    if form == "jsonl":
        stamps = {} if journal is None else stamps_of(found.sources)
        return JsonLinesWriter(
            stream, lambda it: _record(it) if journal is None else journal.record(_record(it), stamps[it.row["file"]])
        )
    return TextWriter(stream, lambda answer: answer.text if isinstance(answer, PairAnswer) else "")


def _record(answer: Answer) -> Record:
    named = {"file": name_as_data(answer.row["file"])}
    named |= {} if answer.row["label"] is None else {"label": answer.row["label"]}
    record = answer.record if isinstance(answer, PairAnswer) else None
    return named | ({"error": answer.error} if record is None else record)


def _row_of(record: Record) -> dict[str, Any]:
    """What `called` and conditions want to know of a record of an earlier run."""
    return {"file": record["file"], "label": record.get("label")} | numbers_of(record)


def _about_page(prediction: Path, truth: Path) -> dict[str, Any]:
    from topokit.comparison.page import COLUMNS as OF_PAGE

    return {"title": f"{prediction.name} against {truth.name}", "columns": OF_PAGE}


def _worded(error: TopokitError) -> str:
    return error.worded(_flag)


def _flag(option: Option) -> str:
    return f"--{option.name} {option.value or ''}".rstrip()


def _ignored(text: str | None) -> float | str | None:
    """A number, or a path."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return text
