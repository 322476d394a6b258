"""Many files at once: `survey` gives their rows, ready for a table, and numbers about the whole set."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

from topokit.batch.distribution import SurveySummary, TopologyDistance, summarize, topology_distance
from topokit.batch.examine import Answer, Given, Questions, Row, called, examine, failure
from topokit.batch.limits import NO_LIMITS, Limits
from topokit.batch.processes import map_in_processes, n_cores
from topokit.batch.sources import Paths, Source, Sources, find_sources
from topokit.errors import InputError

if TYPE_CHECKING:
    from topokit.pages import Entry


class Survey:
    """The rows of many files, examined while they are asked for.

    Iterating gives each row as soon as it is known; rows are kept, so nothing is examined twice. A row is a dictionary
    with the same keys for every file and plain values, None where something is unknown: `file`, `label`, `adapter`,
    `verdict`, `confidence`, `euler`, `genus`, `components`, `cavities`, `tunnels`, `boundary_loops`, `closed`,
    `manifold`, `resolution`, `estimate`, `refined`, `reason`, `seconds`, `error`. So `pandas.DataFrame(survey.rows)` or
    `polars.DataFrame(survey.rows)` is a table. A file that could not be examined has a row, too, with its `error`.

    Attributes:
        files: names of the files, in order.
        passed_over: names of the files in folders that are of no known format.
    """

    def __init__(self, sources: Sources, questions: Questions, jobs: int, limits: Limits = NO_LIMITS) -> None:
        self.files = tuple(source.name for source in sources.sources)
        self.passed_over = sources.passed_over
        self._sources, self._questions, self._jobs, self._limits = sources.sources, questions, jobs, limits
        self._rows: list[list[Row]] = []  # of every file that was examined so far

    def __iter__(self) -> Iterator[Row]:
        for rows in self._rows:
            yield from rows
        n_known = len(self._rows)
        with closing(examine_each(self._sources[n_known:], self._questions, self._jobs, self._limits)) as coming:
            for number, answers in enumerate(coming, n_known):
                if number == len(self._rows):  # else another iterator was here before
                    self._rows.append([answer.row for answer in answers])
                yield from self._rows[number]

    def __repr__(self) -> str:
        return f"Survey({len(self.files)} files, {len(self._rows)} examined)"

    @property
    def rows(self) -> list[Row]:
        """All rows."""
        return list(self)

    def save_html(self, path: str | os.PathLike[str], *, title: str | None = None) -> None:
        """Write a page with a table of all files and a 3D view of each; files are examined for it, known rows or not.

        Args:
            path: file to write, called .html or .htm.
            title: heading of the page; the file's name by default.

        Raises:
            InputError: if the file is not called .html or .htm, or its folder does not exist.
        """
        from topokit.pages import write_html

        questions = replace(self._questions, with_page=True)
        with closing(examine_each(self._sources, questions, self._jobs, self._limits)) as coming:
            write_html((entry(answer) for answers in coming for answer in answers), path, title=title)

    def summary(self) -> SurveySummary:
        """Shares of verdicts and of closed and manifold shapes, histograms of genus and components."""
        return summarize(self.rows)

    def distance(self, other: Survey) -> TopologyDistance:
        """How far the topologies of two sets of shapes are apart, such as generated ones and those to learn from.

        Raises:
            InputError: if a set has no shape that could be examined.
        """
        return topology_distance(self.rows, other.rows)


def survey(
    paths: Paths,
    *,
    jobs: int = 1,
    time_limit: float | None = None,
    memory_limit: float | None = None,
    adapter: str | None = None,
    labels: Literal["all"] | Sequence[int] | None = None,
    details: bool = False,
    **options: Any,
) -> Survey:
    """Examine many files: one row for each, whatever happens.

    Args:
        paths: files, folders and patterns, one or several. Of a folder and the folders in it, the files are taken that
            an adapter knows.
        jobs: number of processes; 1 stays in this one, 0 is one for each core. A process that dies, as in a reader
            that crashes, costs one row; adapters must then be installed packages, not registered in a script.
        time_limit: seconds that a file may take; one that takes longer costs a row with an error. Files are then
            examined in processes of their own, also if there is only one job.
        memory_limit: GiB of memory that the process of a file may hold, likewise; Python and torch take 0.3 of it.
        adapter: name of the adapter to use; by content and suffix by default.
        labels: examine each label of labeled volumes as a shape of its own: "all" or a list of them.
        details: as for `Shape.report`.
        options: of the adapters, as for `topokit.load`; a `generator` is used for every file from its seed on.

    Returns:
        A `Survey`: iterate over it, or take its `rows`, its `summary()` or the `distance()` to another one.

    Raises:
        InputError: if `jobs` is negative, or a limit is not positive.

    Example:
        >>> import tempfile, topokit as tk
        >>> from pathlib import Path
        >>> from topokit.testing import genus_mesh
        >>> folder = Path(tempfile.mkdtemp())
        >>> for genus in (1, 2, 2):
        ...     _ = tk.from_mesh(genus_mesh(genus)).to_trimesh().export(folder / f"{len(list(folder.iterdir()))}.off")
        >>> tk.survey(folder).summary().genus
        {1: 1, 2: 2}
    """
    if jobs < 0:
        raise InputError(f"jobs must be 0 or more, not {jobs}.")
    for name, limit in (("time_limit", time_limit), ("memory_limit", memory_limit)):
        if limit is not None and not limit > 0:
            raise InputError(f"{name} must be positive, not {limit}.")
    if hasattr(options.get("generator"), "initial_seed"):
        options["generator"] = options["generator"].initial_seed()
    questions = Questions(Given(adapter, options), labels, details)
    return Survey(find_sources(paths, adapter), questions, jobs, Limits(time_limit, memory_limit))


def examine_each(
    sources: Sequence[Source], questions: Questions, jobs: int, limits: Limits = NO_LIMITS
) -> Generator[list[Answer]]:
    """The answers about each source, in order, as they come.

    Args:
        sources: files.
        questions: what to ask.
        jobs: number of processes; 1 stays in this one unless there are limits, 0 is one for each core.
        limits: on each file.
    """
    ask: Callable[[Source], list[Answer]] = partial(examine, questions=questions)
    jobs = jobs or n_cores()
    if (jobs == 1 and not limits) or not sources:
        yield from map(ask, sources)
        return
    with closing(map_in_processes(ask, sources, min(jobs, len(sources)), _after_death, limits)) as coming:
        yield from coming


def entry(answer: Answer) -> Entry:
    """The row of a page for an answer."""
    from topokit.pages import Entry

    return Entry(called(answer.row), answer.fragment, answer.error, answer.row["seconds"])


def _after_death(source: Source, how: str) -> list[Answer]:
    return [failure(source, f"{source.name}: {how}.", None)]
