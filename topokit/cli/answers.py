"""One answer per file: printed as it comes or as one JSON array; a file that fails does not stop the others."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

from topokit.cli.options import in_shell
from topokit.errors import TopokitError

Answer = tuple[Mapping[str, Any], str]


def answer_each(files: list[Path], answer: Callable[[Path], Answer], as_json: bool = False) -> None:
    """Print the answers about files and leave: exit code 1 if one of them failed, else 0.

    Args:
        files: paths.
        answer: gives, for a path, an object for JSON and a text.
        as_json: whether to print one JSON array of these objects instead of the texts.
    """
    rows: list[dict[str, Any]] = []
    with _progress(len(files)) as advance:
        for path in files:
            try:
                row, text = answer(path)
                if not as_json:
                    typer.echo(text)
            except TopokitError as error:
                row = {"error": in_shell(str(error), path)}
                typer.echo(f"topokit: {row['error']}", err=True)
            rows.append({"file": str(path), **row})
            advance()
    if as_json:
        typer.echo(json.dumps(rows, indent=2, ensure_ascii=False, allow_nan=False))
    raise typer.Exit(int(any("error" in row for row in rows)))


@contextmanager
def _progress(n_files: int) -> Iterator[Callable[[], None]]:
    """A bar on stderr if that is a terminal and there is more than one file."""
    if n_files < 2 or not sys.stderr.isatty():
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("files", total=n_files)
        yield lambda: bar.advance(task)
