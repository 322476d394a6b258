"""Many files at once: `survey` gives their rows, ready for a table, and numbers about the whole set."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from topokit.batch.dispatch import examine_each, in_order
from topokit.batch.distribution import SurveySummary, TopologyDistance, summarize, topology_distance
from topokit.batch.examine import COLUMNS, Answer, Options, Questions, Row, called
from topokit.batch.journal import Journal, plain_options, stamps_of
from topokit.batch.limits import NO_LIMITS, Limits
from topokit.batch.names import name_as_data, names_in_common_folder
from topokit.batch.sources import Paths, Sources, find_sources
from topokit.batch.widths import width_columns
from topokit.ending import written_whole
from topokit.errors import InputError, requiring
from topokit.inputs.remote import is_address
from topokit.report.wording import plural
from topokit.text import json_text

if TYPE_CHECKING:
    import pandas

    from topokit.pages import Entry


_SHOWN = ("file", "verdict", "euler", "genus", "components", "pieces", "closed", "boundary_loops", "error")
_MOST_ROWS = 200  # in a notebook


class Survey:
    """The rows of many files or shapes, examined while they are asked for.

    Iterating gives each row as soon as it is known; rows are kept, so nothing is examined twice. A row is a dictionary
    with the same keys for every file and plain values, None where something is unknown: `file`, `label`, `adapter`,
    `verdict`, `confidence`, `euler`, `genus`, `components`, `pieces`, `tunnels`, `cavities`, `solid_euler`,
    `boundary_loops`, `closed`, `manifold`, `flipped`, `inverted`, `self_intersections`, `resolution`, `estimate`,
    `refined`, `reason`, `seconds`, `error`; with `features` also `narrowest_part`, `narrowest_tunnel` and
    `narrowest_cavity`, infinite if there is none, and of a width the counts `above_pieces`, `above_tunnels`,
    `above_cavities`, `above_euler` and `above_genus`. So `survey.to_pandas()` or `polars.DataFrame(survey.rows)` is a
    table. A file that could not be examined has a row, too, with its `error`.

    Attributes:
        files: names of the files and shapes, in order.
        passed_over: names of the files in folders that are of no known format.
    """

    def __init__(
        self,
        sources: Sources,
        questions: Questions,
        jobs: int,
        limits: Limits = NO_LIMITS,
        client: Any = None,
        journal: Journal | None = None,
    ) -> None:
        self.files = tuple(source.name for source in sources.sources)
        self.passed_over = sources.passed_over
        self._sources, self._questions = sources.sources, questions
        self._columns = (*COLUMNS, *width_columns(questions.asked.get("features", False)))
        self._workers = jobs, limits, client
        self._journal = journal
        self._stamps = {} if journal is None else stamps_of(sources.sources)
        self._rows = {} if journal is None else self._finished(journal)  # by the numbers of files

    def __iter__(self) -> Iterator[Row]:
        given: set[int] = set()
        while known := sorted(self._rows.keys() - given):  # more may become known while these are looked at
            for number in known:
                yield from self._rows[number]
            given.update(known)
        left = [number for number in range(len(self.files)) if number not in given]
        with closing(examine_each([self._sources[n] for n in left], self._questions, *self._workers)) as coming:
            for place, answers in coming:
                number = left[place]
                if number not in self._rows:  # else another iterator was here before
                    self._keep(number, [answer.row for answer in answers])
                yield from self._rows[number]

    def __len__(self) -> int:
        """Number of files and shapes; a labeled volume is one, whatever the number of its rows."""
        return len(self.files)

    def __getitem__(self, number: int) -> Row:
        """One of `rows`."""
        return self.rows[number]

    def __repr__(self) -> str:
        return f"Survey({plural(len(self), 'file')}, {len(self._rows)} examined)"

    def _repr_html_(self) -> str:
        """What a notebook shows: a table of the rows that are known."""
        from topokit.report.report import environment

        known = [row for _, rows in sorted(self._rows.items()) for row in rows]
        return (
            environment().get_template("survey.html").render(title=repr(self), rows=known[:_MOST_ROWS], columns=_SHOWN)
        )

    def to_pandas(self) -> pandas.DataFrame:
        """All rows as a data frame of pandas, with a column for each key.

        Raises:
            MissingDependencyError: if pandas is not installed.
        """
        with requiring("to_pandas needs pandas: pip install pandas."):
            import pandas
        return pandas.DataFrame(self.rows, columns=list(self._columns))

    @property
    def rows(self) -> list[Row]:
        """All rows, in the order of files."""
        deque(self, maxlen=0)
        return [row for _, rows in sorted(self._rows.items()) for row in rows]

    def save_html(self, path: str | os.PathLike[str], *, title: str | None = None, light: bool = False) -> None:
        """Write a page with a table of all files and a 3D view of each; files are examined for it, known rows or not.

        The page calls files by their paths below the folder that they have in common.

        Args:
            path: file to write, called .html or .htm.
            title: heading of the page; the file's name by default.
            light: whether to leave out pictures and 3D views, for thousands of files.

        Raises:
            InputError: if the file is not called .html or .htm, or its folder does not exist.
        """
        from topokit.pages import write_html

        questions = replace(self._questions, page="light" if light else "full")
        with closing(examine_each(self._sources, questions, *self._workers)) as coming:
            names = names_in_common_folder(self._sources)
            ordered = in_order(coming)
            write_html((entry(answer, names) for _, answers in ordered for answer in answers), path, title=title)

    def save_parquet(self, path: str | os.PathLike[str]) -> None:
        """Write all rows as a Parquet file, in the order of files; the columns have the same types in every file.

        A name that is not UTF-8 is written as the file: address of its file.

        Args:
            path: file to write; it appears when it is complete.

        Raises:
            MissingDependencyError: if pyarrow is not installed.
            InputError: if the file cannot be written.
        """
        from topokit.batch.parquet import write_parquet

        write_parquet(self._in_order(), path, self._columns)

    def summary(self) -> SurveySummary:
        """Shares of verdicts and of closed and manifold shapes, histograms of genus and components."""
        return summarize(self.rows)

    def distance(self, other: Survey) -> TopologyDistance:
        """How far the topologies of two sets of shapes are apart, such as generated ones and those to learn from.

        Raises:
            InputError: if a set has no shape that could be examined.
        """
        return topology_distance(self.rows, other.rows)

    def _in_order(self) -> Iterator[Row]:
        yield from self.rows

    def _finished(self, journal: Journal) -> dict[int, list[Row]]:
        """The rows of the files that are in a journal already."""
        records = journal.finished(self._stamps).records
        known = ((number, name) for number, name in enumerate(self.files) if name in records)
        return {number: [row | {"file": name} for row in records[name]] for number, name in known}

    def _keep(self, number: int, rows: list[Row]) -> None:
        rows = [dict.fromkeys(self._columns) | row for row in rows]
        self._rows[number] = rows
        if self._journal is not None:
            from topokit.report.report import plain

            name = self.files[number]
            values = ({key: plain(value) for key, value in row.items()} | {"file": name_as_data(name)} for row in rows)
            records = (self._journal.record(one, self._stamps[name]) for one in values)
            with written_whole(), self._journal.path.open("a", encoding="utf-8") as file:
                file.writelines(f"{json_text(record)}\n" for record in records)


def survey(
    paths: Paths,
    *,
    jobs: int = 1,
    time_limit: float | None = None,
    memory_limit: float | None = None,
    client: Any = None,
    resume: str | os.PathLike[str] | None = None,
    retry_failed: bool = False,
    adapter: str | None = None,
    labels: Literal["all"] | Sequence[int] | None = None,
    details: bool = False,
    features: bool | float = False,
    **options: Any,
) -> Survey:
    """Examine many files or shapes: one row for each, whatever happens.

    With several processes or a cluster rows come as they are known, in any order; `Survey.rows` has that of the files.

    Args:
        paths: files, folders and patterns, one or several, or a list of shapes. Of a folder and the folders in it, the
            files are taken that an adapter knows. Shapes are called by their names: `shape.replace(name=...)`.
        jobs: number of processes; 1 stays in this one, 0 is one for each core. A process that dies, as in a reader
            that crashes, costs one row. Adapters that a script registered are sent to the processes; an error says so
            if one cannot be sent, before any file is examined.
        time_limit: seconds that a file may take; one that takes longer costs a row with an error. Files are then
            examined in processes of their own, also if there is only one job.
        memory_limit: GiB of memory that the process of a file may hold, likewise; Python and torch take 0.3 of it.
        client: a `dask.distributed.Client`, whose workers examine the files instead. They must see them under the same
            paths. A worker that dies costs a retry, a file that ends all workers that try it one row.
        resume: file of JSON lines, to which the rows of each file are added as soon as they are known. Files that are
            in it already are not examined again: so a survey that was stopped goes on where it was, with the same
            options, which the lines hold. A file is known by its real path, size and time of last change; one that
            was changed is examined again.
        retry_failed: examine those files of it again that failed.
        adapter: name of the adapter to use; by content and suffix by default.
        labels: examine each label of labeled volumes as a shape of its own: "all" or a list of them.
        details: as for `Shape.report`.
        features: likewise. True adds the columns of the narrowest features, a width also the counts above it.
        options: of the adapters, as for `topokit.load`; a `generator` is used for every file from its seed on.

    Returns:
        A `Survey`: iterate over it, or take its `rows`, its `summary()` or the `distance()` to another one.

    Raises:
        InputError: if `jobs` is negative, a limit is not positive, the only path that is given does not exist,
            something else than paths is given, or the file to resume is no survey, or one with other options.

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
    questions = Questions(Options(adapter, options), labels, {"details": details, "features": features})
    journal = None
    if resume is not None:
        given = plain_options(adapter, options, labels=labels, details=details, features=features)
        columns = (*COLUMNS, *width_columns(features))
        journal = Journal(Path(resume), given, columns, several=labels is not None, retries=retry_failed)
    sources = find_sources(paths, adapter)
    _require_something(paths, sources)
    in_memory = [source for source in sources.sources if source.shape is not None]
    if in_memory and journal is not None:
        raise InputError("resume is for files: shapes in memory cannot be known again.")
    if in_memory and len(in_memory) == len(sources.sources) and (options or adapter is not None or labels is not None):
        named = [*options, *(["adapter"] if adapter is not None else []), *(["labels"] if labels is not None else [])]
        raise InputError(f"{', '.join(named)}: these are for opening files, and the shapes are open already.")
    return Survey(sources, questions, jobs, Limits(time_limit, memory_limit), client, journal)


def _require_something(paths: Paths, sources: Sources) -> None:
    """Refuse a path that does not exist if there is no other: among several files it costs a row."""
    if isinstance(paths, str | os.PathLike) and not is_address(paths):
        (source, *more) = sources.sources
        if not more and not os.path.lexists(source.path):
            raise InputError(f"{source.name} does not exist, nor is it a pattern that matches files.")


def entry(answer: Answer, names: Mapping[str, str]) -> Entry:
    """The row of a page for an answer, with what to call each file."""
    from topokit.pages import Entry

    file = answer.row["file"]
    name = called(answer.row | {"file": names[file]})
    error = None if answer.error is None else answer.error.replace(file, names[file])
    return Entry(name, answer.fragment, error, answer.row["seconds"])
