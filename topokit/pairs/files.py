"""The files of two folders matched by name, and the examination of one such pair: a row for each pair or label."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from topokit.batch.examine import Answer, Row, timed_answers
from topokit.batch.sources import Source
from topokit.errors import InputError, TopokitError

if TYPE_CHECKING:
    from topokit.comparison.result import Comparison

NUMBERS = tuple(
    f"{kind}{k}"
    for kind, k in product(
        ("betti_a", "betti_b", "matched", "missing", "spurious", "betti_error", "betti_matching_error"), range(3)
    )
)
COLUMNS = ("file", "label", *NUMBERS, "dice", "seconds", "error")


@dataclass(frozen=True)
class PairQuestions:
    """What to ask about each pair; it is sent to the worker processes.

    Attributes:
        labels: of labeled volumes, "all" or some; None compares every pair as two solids.
        options: keywords of `topokit.compare`, or of `compare_labels`.
        form: what the answers hold beside rows: "text", a "record" for JSON, or None.
        with_page: whether they hold what an HTML page shows.
        worded: the message of an error for those who gave the options; a function of a module.
    """

    labels: Literal["all"] | tuple[int, ...] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    form: Literal["text", "record"] | None = None
    with_page: bool = False
    worded: Callable[[TopokitError], str] = str


@dataclass(frozen=True)
class PairAnswer(Answer):
    """What was found out about one pair; its row has the values of `COLUMNS`.

    Attributes:
        record: the comparison as JSON has it, if it was asked for and there is one.
        text: likewise as people read it.
    """

    record: dict[str, Any] | None = None
    text: str = ""


def matched_files(a: Path, b: Path) -> tuple[Source, ...]:
    """The files of two folders by their names without suffix, sorted; the truth of each is beside it.

    A file without partner has a problem.

    Raises:
        InputError: if two files in one folder have the same name.
    """
    found: tuple[dict[str, Path], dict[str, Path]] = {}, {}
    for folder, named in zip((a, b), found, strict=True):
        for path in sorted(path for path in folder.iterdir() if not path.name.startswith(".")):
            name = Path(path.stem).stem if path.suffix.lower() == ".gz" else path.stem
            if name in named:
                raise InputError(f"{folder} has both {named[name].name} and {path.name}: files are matched by name.")
            named[name] = path
    sources = []
    for name in sorted(found[0].keys() | found[1].keys()):
        one, other = (named.get(name) for named in found)
        lacking = None if one and other else f"{b if one else a} has no file of this name."
        sources.append(Source(one or a / name, name, lacking, beside=(other or b / name,)))
    return tuple(sources)


def compare_files(source: Source, questions: PairQuestions) -> list[PairAnswer]:
    """The answers about a pair of files: one, or one for each label.

    Whatever is raised, other than an interrupt, becomes an answer with an error.
    """

    def failed(error: TopokitError, seconds: float) -> PairAnswer:
        return failure(source, questions.worded(error), seconds)

    answers = (_answer(source.name, label, found, questions) for label, found in _compared(source, questions))
    return timed_answers(source, answers, "compared", failed)


def failure(source: Source, problem: str, seconds: float | None = None) -> PairAnswer:
    """The answer about a pair that could not be compared."""
    known = {"file": source.name, "seconds": seconds, "error": f"{source.name}: {problem}"}
    return PairAnswer(dict.fromkeys(COLUMNS) | known)


def after_death(source: Source, how: str) -> list[PairAnswer]:
    """The answers about a pair whose process died, and how."""
    return [failure(source, f"{how}.")]


def _compared(source: Source, questions: PairQuestions) -> Iterator[tuple[int | None, Comparison]]:
    """The comparisons of a pair by their labels."""
    from topokit.pairs.compare import compare, compare_labels

    truth = source.beside[0]
    if questions.labels is None:
        yield None, compare(source.path, truth, **questions.options)
    else:
        yield from compare_labels(source.path, truth, questions.labels, **questions.options).items()


def _answer(name: str, label: int | None, found: Comparison, questions: PairQuestions) -> PairAnswer:
    """What was asked for about one comparison."""
    fragment = None
    if questions.with_page:
        from topokit.comparison.page import entry_of

        fragment = entry_of(found, name).fragment
    return PairAnswer(
        row_of(name, label, found),
        fragment=fragment,
        record=found.to_dict() if questions.form == "record" else None,
        text=found.text() if questions.form == "text" else "",
    )


def row_of(name: str, label: int | None, found: Comparison) -> Row:
    """A comparison as plain values under the names of `COLUMNS`, without the time it took."""
    numbers = {column: getattr(found, column[:-1])[int(column[-1])] for column in NUMBERS}
    more = {"dice": round(found.solids.dice, 6), "seconds": None, "error": None}
    return {"file": name, "label": label, **numbers, **more}


def numbers_of(record: Mapping[str, Any], columns: Sequence[str] = NUMBERS) -> Row:
    """The numbers of a record, as `Comparison.to_dict` makes them, under the names of columns; None where it failed."""
    return {column: record[column[:-1]][int(column[-1])] if column[:-1] in record else None for column in columns}
