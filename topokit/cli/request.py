"""Options of the commands that examine files: which files, in how many processes, and what sets the exit code."""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from topokit.batch.limits import Limits
from topokit.batch.sources import Source, Sources, find_sources
from topokit.cli.bundle import bundled
from topokit.cli.conditions import EXPECTED, Condition, parse_conditions
from topokit.ending import finally_do

STDIN = "-"


@dataclass(frozen=True)
class Request:
    """How to examine files.

    Attributes:
        format: of standard input, as the suffix of a file.
        labels: as for `topokit.survey`.
        jobs: number of processes.
        cluster: address of the scheduler whose workers examine the files, or "local"; or None.
        limits: on each file.
        conditions: what makes the exit code 1.
        keep_going: whether to go on after a failure.
        verbose: whether to say more on standard error.
    """

    format: str | None
    labels: Literal["all"] | tuple[int, ...] | None
    jobs: int
    cluster: str | None
    limits: Limits
    conditions: Sequence[Condition]
    keep_going: bool
    verbose: bool


Format = Annotated[
    str | None, typer.Option("--format", metavar="SUFFIX", help="Format of standard input (FILE is -), such as stl.")
]
LIMITS = {
    "time_limit": Annotated[
        float | None, typer.Option("--time-limit", metavar="SECONDS", min=0.1, help="The most that a file may take.")
    ],
    "memory_limit": Annotated[
        float | None,
        typer.Option("--memory-limit", metavar="GIB", min=0.1, help="The most memory that a file may take."),
    ],
}
_SUFFIX = re.compile(r"\.?[A-Za-z0-9.]+")
_OPTIONS = {
    "format": Format,
    "labels": Annotated[
        str | None, typer.Option("--labels", metavar="all|1,2,…", help="Volumes: each label as a shape of its own.")
    ],
    "jobs": Annotated[
        int | None, typer.Option("-j", "--jobs", min=0, help="Processes; 0 is one for each core.", show_default="1")
    ],
    "cluster": Annotated[
        str | None,
        typer.Option("--cluster", metavar="ADDRESS|local", help="Dask scheduler whose workers examine the files."),
    ],
    **LIMITS,
    "fail_on": Annotated[
        list[str] | None,
        typer.Option("--fail-on", metavar="CONDITION", help=f"Exit with 1 if a shape is {EXPECTED}. May be repeated."),
    ],
    "keep_going": Annotated[
        bool | None,
        typer.Option("--keep-going/--fail-fast", help="Go on after a failure, or stop.", show_default="keep-going"),
    ],
    "verbose": Annotated[bool | None, typer.Option("-v", "--verbose", help="Say more on standard error.")],
}


def _request(
    format: str | None,
    labels: str | None,
    jobs: int | None,
    cluster: str | None,
    time_limit: float | None,
    memory_limit: float | None,
    fail_on: list[str] | None,
    keep_going: bool | None,
    verbose: bool | None,
) -> Request:
    try:
        conditions = parse_conditions(fail_on or ())
    except ValueError as error:
        raise typer.BadParameter(f"--fail-on: {error}") from error
    is_going = keep_going is None or keep_going
    limits = Limits(time_limit, memory_limit)
    n_jobs = int(cluster is None) if jobs is None else jobs
    return Request(format, _labels(labels), n_jobs, cluster, limits, conditions, is_going, bool(verbose))


def _labels(text: str | None) -> Literal["all"] | tuple[int, ...] | None:
    if text is None or text == "all":
        return text  # type: ignore[return-value]
    try:
        return tuple(map(int, text.split(",")))
    except ValueError as error:
        raise typer.BadParameter(
            f"--labels is {text!r}; expected all, or integers with commas between them."
        ) from error


examines_files = bundled("request", _OPTIONS, _request)


def is_same(output: Path, source: Source) -> bool:
    """Whether a file to write is the one to read."""
    return isinstance(source.path, Path) and output.exists() and source.path.exists() and output.samefile(source.path)


@contextmanager
def sources_of(texts: Sequence[str], format: str | None, adapter: str | None) -> Iterator[Sources]:
    """The files that the arguments stand for; - is standard input, which is kept in a file during the block."""
    texts = list(texts)
    if texts.count(STDIN) > 1 or (format is not None and STDIN not in texts):
        raise typer.BadParameter("--format is that of standard input: give - as FILE, once.")
    if format is not None and not _SUFFIX.fullmatch(format):
        raise typer.BadParameter(f"--format is {format!r}; expected the suffix of a file, such as stl.")
    if STDIN not in texts:
        yield find_sources(texts, adapter)
        return
    place = texts.index(STDIN)
    before, after = find_sources(texts[:place], adapter), find_sources(texts[place + 1 :], adapter)
    folder = tempfile.TemporaryDirectory(prefix="topokit-", ignore_cleanup_errors=True)
    with finally_do(folder.cleanup):
        path = Path(folder.name) / ("stdin" if format is None else f"stdin.{format.lower().lstrip('.')}")
        path.write_bytes(sys.stdin.buffer.read())
        sources = (*before.sources, Source(path, STDIN), *after.sources)
        yield Sources(sources, before.passed_over + after.passed_over)
