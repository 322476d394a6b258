"""The examination of one file: a row for each shape in it, and whatever else was asked for; an error is a row, too."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from topokit.batch.sources import Source
from topokit.batch.widths import width_values
from topokit.errors import InputError, TopokitError
from topokit.plugins.foreign_code import foreign_code
from topokit.plugins.registry import adapter_for, in_reach, load, load_labels

if TYPE_CHECKING:
    from topokit.pages import Fragment
    from topokit.report.report import TopologyReport
    from topokit.shape import Shape

Row = dict[str, Any]
Found = TypeVar("Found", bound="Answer")

COLUMNS = (
    "file",
    "label",
    "adapter",
    "verdict",
    "confidence",
    "euler",
    "genus",
    "components",
    "pieces",
    "tunnels",
    "cavities",
    "solid_euler",
    "boundary_loops",
    "closed",
    "manifold",
    "flipped",
    "inverted",
    "self_intersections",
    "resolution",
    "estimate",
    "refined",
    "reason",
    "seconds",
    "error",
)


@dataclass(frozen=True)
class Options:
    """The options of `topokit.load`, the same for every file, unless a subclass makes them from its path.

    Attributes:
        adapter: name of the adapter, or None to choose by content and suffix.
        given: values by the name of the adapter's parameter.
    """

    adapter: str | None = None
    given: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, path: Path | str) -> tuple[str, Mapping[str, Any]]:
        """The adapter's name and its options."""
        return adapter_for(path, self.adapter).name, self.given

    def worded(self, error: TopokitError) -> str:
        """The message of an error for those who gave the options."""
        return str(error)


@dataclass(frozen=True)
class Questions:
    """What to ask about each file; it is sent to the worker processes.

    Attributes:
        options: gives the adapter and its options for a path.
        labels: of a labeled volume, "all" or some; None examines every file as one shape.
        asked: keywords of `Shape.report`.
        with_report: whether the answers hold the reports.
        page: whether the answers hold what an HTML page shows: "full" with a 3D view, "light" without, None for none.
        client: of a Dask cluster whose workers share the file; then the questions are not sent anywhere.
    """

    options: Options = Options()
    labels: Any = None
    asked: Mapping[str, Any] = field(default_factory=dict)
    with_report: bool = False
    page: Literal["full", "light"] | None = None
    client: Any = None


@dataclass(frozen=True)
class Answer:
    """What was found out about one shape.

    Attributes:
        row: the values of `COLUMNS`, and of `width_columns` if widths were asked for; None where they are unknown.
        report: the report, if it was asked for and there is one.
        fragment: its part of an HTML page, likewise.
    """

    row: Row
    report: TopologyReport | None = None
    fragment: Fragment | None = None

    @property
    def error(self) -> str | None:
        """What went wrong, or None."""
        error: str | None = self.row["error"]
        return error


def examine(source: Source, questions: Questions) -> list[Answer]:
    """The answers about one file: one, or one for each label of a labeled volume.

    Whatever is raised, other than an interrupt, becomes an answer with an error.
    """

    def failed(error: TopokitError, seconds: float) -> Answer:
        error.rename(str(source.path), source.name)
        return failure(source, questions.options.worded(error), seconds)

    return timed_answers(source, _answers(source, questions), "examined", failed)


def timed_answers(
    source: Source, answers: Iterator[Found], done: str, failed: Callable[[TopokitError, float], Found]
) -> list[Found]:
    """Answers with the seconds that each took; what is raised becomes the last one.

    Args:
        source: what the answers are about.
        answers: found one by one.
        done: what was to be done with the source, for the message of an error that is not our own.
        failed: the answer of an error, after some seconds.
    """
    import topokit.shape  # noqa: F401  (torch is imported before the clock starts)

    found: list[Found] = []
    started = time.perf_counter()
    try:
        if source.problem is not None:
            raise InputError(source.problem)
        with foreign_code(f"{source.path} could not be {done}"):
            for answer in answers:
                answer.row["seconds"] = time.perf_counter() - started
                found.append(answer)
                started = time.perf_counter()
    except TopokitError as error:
        found.append(failed(error, time.perf_counter() - started))
    return found


def _answers(source: Source, questions: Questions) -> Iterator[Answer]:
    """The answer about each shape of a source."""
    with _opened(source, questions) as (adapter, shapes):
        for label, shape in shapes:
            answer = _answer(shape, questions)  # samples and counts are made only now
            yield replace(answer, row=answer.row | {"file": source.name, "label": label, "adapter": adapter})


def _answer(shape: Shape, questions: Questions) -> Answer:
    """What was asked for about one shape."""
    report, fragment = shape.report(**questions.asked), None
    if questions.page is not None:
        from topokit.pages import page_of

        fragment = page_of(shape, report, light=questions.page == "light")
    row = report_row(report, shape) | width_values(report, questions.asked.get("features", False))
    return Answer(row, report if questions.with_report else None, fragment)


def failure(source: Source, problem: str, seconds: float | None) -> Answer:
    """The answer about a file that could not be examined."""
    return Answer(dict.fromkeys(COLUMNS) | {"file": source.name, "seconds": seconds, "error": problem})


def report_row(report: TopologyReport, shape: Shape) -> Row:
    """A report as plain values under the names of `COLUMNS`."""
    values = {
        "verdict": report.verdict,
        "confidence": report.confidence,
        "euler": report.euler,
        "genus": report.genus,
        "components": report.components,
        "pieces": report.pieces,
        "tunnels": report.tunnels,
        "cavities": report.cavities,
        "solid_euler": report.solid_euler,
        "boundary_loops": report.boundary_loops,
        "closed": report.closed,
        "manifold": _is_manifold(report, shape),
        "flipped": report.flipped,
        "inverted": report.inverted,
        "self_intersections": report.self_intersections,
        "resolution": report.resolution,
        "estimate": report.estimate,
        "refined": report.refined,
        "reason": report.reasons[0] if report.reasons else None,
    }
    return dict.fromkeys(COLUMNS) | values


def _is_manifold(report: TopologyReport, shape: Shape) -> bool | None:
    """Of a mesh what counting says; of samples only if they are closed."""
    if report.closed:
        return True
    return None if shape.counted is None else shape.counted.manifold


@contextmanager
def _opened(source: Source, questions: Questions) -> Iterator[tuple[str | None, Iterable[tuple[int | None, Shape]]]]:
    """During the block the adapter of a source, and its shapes by their labels."""
    if source.shape is not None:
        yield None, [(None, source.shape)]
        return
    with in_reach(source.path, questions.options.adapter) as path:
        adapter, given = questions.options(path)
        options = seeded(given) | ({} if questions.client is None else {"client": questions.client})
        if questions.labels is None:
            yield adapter, [(None, load(path, adapter=adapter, **options))]
        else:
            yield adapter, load_labels(path, questions.labels, adapter, **options).items()


def called(row: Row) -> str:
    """What to call a row: its file, perhaps with its label."""
    name: str = row["file"]
    return name if row["label"] is None else f"{name}, label {row['label']}"


def seeded(options: Mapping[str, Any]) -> dict[str, Any]:
    """The options with a new generator, so that no answer depends on the files before it."""
    changed = dict(options)
    if isinstance(changed.get("generator"), int):
        import torch

        changed["generator"] = torch.Generator().manual_seed(changed["generator"])
    return changed
