"""Examining files for a command: results as they come, errors on standard error, and the exit code."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TextIO

import typer

from topokit.batch.dispatch import examine_each, in_order
from topokit.batch.examine import Answer, Questions, Row, called
from topokit.batch.journal import Journal, Record, stamps_of
from topokit.batch.names import names_in_common_folder
from topokit.batch.sources import Source, Sources
from topokit.batch.survey import entry
from topokit.cli.conditions import Condition, needs_places, require_known
from topokit.cli.options import Opener
from topokit.cli.request import Request, Work, is_same, sources_of
from topokit.cli.writers import Writer
from topokit.ending import finally_do, written_whole
from topokit.errors import InputError, TopokitError
from topokit.plugins.registry import adapter_for
from topokit.report.progress import Bar, progress_bar
from topokit.report.wording import plural
from topokit.text import printable

MakeWriter = Callable[[TextIO, Sources], Writer]
Coming = Generator[tuple[int, Sequence[Answer]]]


def answer_files(
    files: list[str],
    opener: Opener,
    request: Request,
    make_writer: MakeWriter,
    *,
    asked: dict[str, Any] | None = None,
    with_report: bool = True,
    output: Path | None = None,
    resume: Journal | None = None,
    html: Path | None = None,
    light: bool = False,
    check: Callable[[Answer], Answer] = lambda answer: answer,
) -> None:
    """Write the answers about files and leave: exit code 1 if one of them failed or met a condition, else 0.

    Args:
        files: what was given on the command line.
        opener: opens them.
        request: how to examine them.
        make_writer: the form of the results, for a stream and what was found.
        asked: keywords of `Shape.report`; none by default.
        with_report: whether the writer needs reports besides rows.
        output: file to write to instead of standard output.
        resume: that file, of JSON lines, to add those files to that are not in it.
        html: page to write besides.
        light: whether it has no pictures and 3D views.
        check: may turn an answer into a failure.
    """
    page: Literal["full", "light"] | None = None if html is None else "light" if light else "full"
    try:
        require_known(request.conditions, (asked or {}).get("features", False))
    except ValueError as error:
        raise typer.BadParameter(f"--fail-on: {error}") from error
    asked = (asked or {}) | ({"locate": True} if needs_places(request.conditions) else {})
    questions = Questions(opener, request.chosen_labels, asked, with_report, page)
    with sources_of(files, request.format, opener.adapter) as found, _cluster(request) as client:
        _say_what_was_passed_over(found, request.verbose)

        def examined(left: Sequence[Source]) -> Coming:
            return examine_each(left, questions, request.n_jobs, request.limits, client)

        has_failed = answer_sources(
            found,
            examined,
            request,
            make_writer,
            output=output,
            resume=resume,
            html=html,
            check=check,
            keeps_order=client is None,
            names_for_bar=lambda left: _names_for_bar(left, opener),
        )
    raise typer.Exit(int(has_failed))


def answer_sources(
    found: Sources,
    examined: Callable[[Sequence[Source]], Coming],
    work: Work,
    make_writer: MakeWriter,
    *,
    output: Path | None = None,
    resume: Journal | None = None,
    row_of: Callable[[Record], Row] | None = None,
    html: Path | None = None,
    about_page: Mapping[str, Any] | None = None,
    check: Callable[[Answer], Answer] = lambda answer: answer,
    keeps_order: bool = True,
    names_for_bar: Callable[[Sources], list[str]] = lambda left: [],
) -> bool:
    """Write the answers about sources; whether one of them failed or met a condition.

    Args:
        found: the sources.
        examined: examines some of them.
        work: how to do it.
        make_writer: the form of the results, for a stream and what was found.
        output: file to write to instead of standard output.
        resume: that file, of JSON lines, to add those sources to that are not in it.
        row_of: a record of it as a row, to which conditions apply; without it they apply to new answers alone.
        html: page to write besides.
        about_page: keywords of `write_html`.
        check: may turn an answer into a failure.
        keeps_order: whether answers are put in the order of the sources where the form of the results wants it.
        names_for_bar: what the bar of progress shows; none for no bar.
    """
    has_failed = had_failed = False

    def shown(
        coming: Iterable[tuple[int, Sequence[Answer]]], writer: Writer, bar: Bar, is_terminal: bool
    ) -> Iterator[Answer]:
        nonlocal has_failed
        for _, answers in coming:
            for answer in map(check, answers):
                met = _met(answer, work.conditions)
                _show(answer, met, writer, bar if is_terminal or answer.error or met else None, work.verbose)
                has_failed = has_failed or answer.error is not None or bool(met)
                yield answer
            if has_failed and not work.keep_going:
                return

    if resume is not None:
        found, records = _unfinished(found, resume)
        had_failed = any(record.get("error") for record in records)
        if row_of is not None:
            rows = [row_of(record) for record in records if "error" not in record]
            had_failed |= sum(_met_before(row, work.conditions) for row in rows) > 0  # each of them says so
    with (
        _stream(output, found, "a" if resume else "w") as stream,
        progress_bar(names_for_bar(found), patience=0) as bar,
        _finished(make_writer(stream, found)) as writer,
        closing(examined(found.sources)) as coming,
    ):
        known = bar.counting(coming)
        is_ordered = keeps_order and (writer.is_ordered or html is not None)
        answers = shown(in_order(known) if is_ordered else known, writer, bar, stream.isatty())
        _write_page(answers, html, found, about_page or {})
    return has_failed or had_failed


def _met_before(row: Row, conditions: Sequence[Condition]) -> bool:
    """Whether a row of an earlier run meets a condition, which standard error says."""
    if met := [one.found(row) for one in conditions if one.meets(row)]:
        say(f"{called(row)} meets {', '.join(met)}")
    return bool(met)


def _met(answer: Answer, conditions: Sequence[Condition]) -> list[str]:
    """The conditions that a shape meets, each with what it found."""
    return [] if answer.error is not None else [one.found(answer.row) for one in conditions if one.meets(answer.row)]


def _write_page(answers: Iterator[Answer], html: Path | None, found: Sources, about_page: Mapping[str, Any]) -> None:
    """Take all answers, and write those to a page, if one is wanted."""
    if html is None:
        deque(answers, maxlen=0)
        return
    from topokit.pages import write_html

    names = names_in_common_folder(found.sources)
    try:
        write_html((entry(answer, names) for answer in answers), html, **about_page)
    except InputError as error:  # about the name of the page, before anything is examined
        raise typer.BadParameter(f"--html: {error}") from error


@contextmanager
def _finished(writer: Writer) -> Iterator[Writer]:
    """A writer that is closed at the end, also if a signal ends the process."""
    with finally_do(writer.close):
        yield writer


def say(message: str) -> None:
    """A line on standard error."""
    typer.echo(f"topokit: {printable(message)}", err=True)


def _show(answer: Answer, met: Sequence[str], writer: Writer, bar: Bar | None, verbose: bool) -> None:
    with written_whole(), nullcontext() if bar is None else bar.hidden():
        writer.write(answer)
        if answer.error is not None:
            say(answer.error)
        elif verbose:
            adapter = answer.row.get("adapter")
            say(f"{answer.row['file']}: {'' if adapter is None else f'{adapter}, '}{answer.row['seconds']:.2f} s")
        if met:
            say(f"{called(answer.row)} meets {', '.join(met)}")


def _names_for_bar(found: Sources, opener: Opener) -> list[str]:
    """As `names_on_terminal`; none either if there is only one file whose adapter draws a bar itself."""
    if len(found.sources) == 1 and sys.stderr.isatty():
        try:
            path = found.sources[0].path
            if isinstance(path, Path) and adapter_for(path, opener.adapter).shows_progress:
                return []
        except TopokitError:  # its answer says so
            return []
    return names_on_terminal(found)


def names_on_terminal(found: Sources) -> list[str]:
    """The names of the sources; none without a terminal."""
    return [source.name for source in found.sources] if sys.stderr.isatty() else []


def _say_what_was_passed_over(found: Sources, verbose: bool) -> None:
    if found.passed_over:
        names = f": {', '.join(found.passed_over)}" if verbose else ""
        verb = "was" if len(found.passed_over) == 1 else "were"
        say(f"{plural(len(found.passed_over), 'file')} of no known format {verb} passed over{names}.")


@contextmanager
def _cluster(request: Request) -> Iterator[Any]:
    """A client of the cluster that is asked for, or None."""
    if request.cluster is None:
        yield None
        return
    from topokit.batch.files_on_dask import connected

    with ExitStack() as stack:
        try:
            client = stack.enter_context(connected(request.cluster, request.n_jobs))
        except TopokitError as error:
            raise typer.BadParameter(f"--cluster: {error}") from error
        if request.verbose:
            say(f"dashboard of the cluster: {client.dashboard_link}")
        yield client


def _unfinished(found: Sources, journal: Journal) -> tuple[Sources, list[Record]]:
    """The sources that are not in the output yet, and the records of those that are."""
    try:
        finished = journal.finished(stamps_of(found.sources))
    except InputError as error:
        raise typer.BadParameter(f"--resume: {error}") from error
    left = tuple(source for source in found.sources if source.name not in finished.records)
    n_done = len(found.sources) - len(left)
    say(f"{plural(n_done, 'file')} of {len(found.sources)} {'was' if n_done == 1 else 'were'} examined before.")
    if n_outdated := finished.n_outdated:
        verb = "is" if n_outdated == 1 else "are"
        say(f"{plural(n_outdated, 'file')} {verb} examined again: changed since, or their lines do not say of when.")
    failed = [name for name, records in finished.records.items() if any(record.get("error") for record in records)]
    if failed:
        say(f"{len(failed)} of them failed; add --retry-failed to examine them again.")
    return replace(found, sources=left), [record for records in finished.records.values() for record in records]


@contextmanager
def _stream(output: Path | None, found: Sources, mode: Literal["a", "w"]) -> Iterator[TextIO]:
    """Standard output, or the file to write, which must not be one of those to read."""
    if output is None:
        yield sys.stdout
        return
    if output.exists() and any(is_same(output, source) for source in found.sources):
        raise typer.BadParameter(f"-o {output} is a file to read; name another one to write.")
    try:
        file = output.open(mode, encoding="utf-8", newline="")
    except OSError as error:
        raise typer.BadParameter(f"-o {output} cannot be written ({error.strerror}).") from error
    with file:
        yield file
