"""Options of the commands that examine files: which files, in how many processes, and what sets the exit code."""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import typer

from topokit.batch.limits import Limits
from topokit.batch.sources import Source, Sources, find_sources
from topokit.cli.conditions import EXPECTED, Condition, parse_conditions
from topokit.ending import finally_do

STDIN = "-"


_SUFFIX = re.compile(r"\.?[A-Za-z0-9.]+")
_LABELS = "Volumes: each label as a shape of its own."
_CLUSTER = "Dask scheduler whose workers examine the files."
_FAIL_ON = f"Exit with 1 if a shape is {EXPECTED}. May be repeated."
Format = Annotated[
    str | None, typer.Option("--format", metavar="SUFFIX", help="Format of standard input (FILE is -), such as stl.")
]
Output = Annotated[Path | None, typer.Option("-o", "--output", help="File to write instead of standard output.")]
Resume = Annotated[
    bool, typer.Option("--resume", help="Go on with the file of -o, written with --jsonl by a run that was stopped.")
]
Limit = float | None


@dataclass(frozen=True)
class Work:
    """How to examine many files, whatever is asked about them."""

    labels: Annotated[str | None, typer.Option(metavar="all|1,2,…", help=_LABELS)] = None
    jobs: Annotated[
        int | None, typer.Option("-j", "--jobs", min=0, help="Processes; 0 is one for each core.", show_default="1")
    ] = None
    time_limit: Annotated[Limit, typer.Option(metavar="SECONDS", min=0.1, help="The most that a file may take.")] = None
    memory_limit: Annotated[
        Limit, typer.Option(metavar="GIB", min=0.1, help="The most memory that a file may take.")
    ] = None
    keep_going: Annotated[bool, typer.Option("--keep-going/--fail-fast", help="Go on after a failure, or stop.")] = True
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="All reasons, and more on standard error.")] = False
    fail_on: Annotated[list[str] | None, typer.Option(metavar="CONDITION", help=_FAIL_ON)] = None

    def __post_init__(self) -> None:
        _ = self.conditions, self.chosen_labels  # usage errors come first

    @property
    def limits(self) -> Limits:
        """On each file."""
        return Limits(self.time_limit, self.memory_limit)

    @property
    def n_jobs(self) -> int:
        """Number of processes: by default one here."""
        return 1 if self.jobs is None else self.jobs

    @cached_property
    def conditions(self) -> list[Condition]:
        """What makes the exit code 1."""
        try:
            return self._parsed(self.fail_on or ())
        except ValueError as error:
            raise typer.BadParameter(f"--fail-on: {error}") from error

    @property
    def chosen_labels(self) -> Literal["all"] | tuple[int, ...] | None:
        """As for `topokit.survey`."""
        if self.labels is None or self.labels == "all":
            return self.labels  # type: ignore[return-value]
        try:
            return tuple(map(int, self.labels.split(",")))
        except ValueError as error:
            raise typer.BadParameter(
                f"--labels is {self.labels!r}; expected all, or integers with commas between them."
            ) from error

    def _parsed(self, texts: Sequence[str]) -> list[Condition]:
        return parse_conditions(texts)


@dataclass(frozen=True)
class Request(Work):
    """How to examine many files that are opened as shapes."""

    format: Format = None
    cluster: Annotated[str | None, typer.Option(metavar="ADDRESS|local", help=_CLUSTER)] = None

    @property
    def n_jobs(self) -> int:
        """Number of processes: by default one here, and one for each core of a local cluster."""
        return int(self.cluster is None) if self.jobs is None else self.jobs


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
