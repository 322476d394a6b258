"""Tables of the paper's page: rows that become Markdown and JSON, statistics over seeds, options of a run."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import mean, stdev
from time import process_time
from typing import Any, TypeVar

Result = TypeVar("Result")


@dataclass(frozen=True)
class Options:
    """What a run was asked for.

    Attributes:
        seeds: number of random draws.
        quick: fewer points, shapes and seeds: a check that the script works.
        data: folder with index.json and the shapes that it names, or None.
        thingi10k: folder with meshes of Thingi10K named by their number, or None.
        pictures: folder that figures are written to.
        every: takes every n-th of the clean meshes of the data.
        part: one of the `PARTS` of the subcommand's module, or "all".
        rows: names of rows of Table II, in the order wanted; empty means all.
        settings: numbers of points and noise of these rows; empty means all.
        methods: groups of methods for the clean meshes; empty means all.
    """

    seeds: int
    quick: bool
    data: Path | None
    thingi10k: Path | None
    pictures: Path
    every: int = 1
    part: str = "all"
    rows: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()


@dataclass
class Table:
    """One table with a title, notes below it, and cells as text."""

    title: str
    header: list[str]
    rows: list[list[str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, *cells: object) -> None:
        self.rows.append([str(cell) for cell in cells])
        print(f"{self.title}: {' | '.join(self.rows[-1])}", file=sys.stderr, flush=True)

    def markdown(self) -> str:
        lines = [f"### {self.title}", ""]
        if self.rows:
            lines += ["| " + " | ".join(row) + " |" for row in (self.header, ["---"] * len(self.header), *self.rows)]
            lines.append("")
        return "\n".join((*lines, *(f"{note}\n" for note in self.notes)))

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def installed(*packages: str) -> bool:
    """Whether optional packages can be imported."""
    return all(importlib.util.find_spec(name) is not None for name in packages)


def missing(package: str, what: str) -> str:
    """The sentence that stands for rows that an absent package leaves out."""
    return f"Without {package} the rows of {what} are left out: `pip install {package}` adds them."


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    """A result and the processor seconds it took, of all threads: what else the machine does hardly counts."""
    started = process_time()
    result = work()
    return result, process_time() - started


def spread(values: Sequence[float], digits: int = 2) -> str:
    """Mean ± standard deviation; the mean alone for one value."""
    if len(values) == 1:
        return f"{values[0]:.{digits}f}"
    return f"{mean(values):.{digits}f} ± {stdev(values):.{digits}f}"


def seeds_text(options: Options) -> str:
    """The number of draws as words."""
    return f"{options.seeds} seed" + "s" * (options.seeds > 1)
