"""Commands about one file: what is said of it, or made of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from topokit.cli.answers import say
from topokit.cli.options import Opener
from topokit.cli.request import is_same, sources_of
from topokit.errors import InputError, TopokitError
from topokit.text import printable

if TYPE_CHECKING:
    from topokit.shape import Shape


def convert(file: str, output: Path, format: str | None, opener: Opener, write: Callable[[Shape], str]) -> None:
    """Open a file, write what is made of its shape, and say so; exit code 1 if that fails.

    Args:
        file: to read; - is standard input.
        output: file to write, which must be another one.
        format: of standard input.
        opener: opens the file.
        write: writes the output, and returns what to say about it.
    """
    ask(file, format, opener, lambda shape: f"{printable(str(output))}: {write(shape)}", output)


def ask(
    file: str, format: str | None, opener: Opener, answer: Callable[[Shape], str], output: Path | None = None
) -> None:
    """Open a file and print what is found out about its shape; exit code 1 if that fails.

    Args:
        file: to read; - is standard input.
        format: of standard input.
        opener: opens the file.
        answer: what to print about the shape; nothing if it is empty.
        output: file that will be written, which must be another one, or None.
    """
    with sources_of([file], format, opener.adapter) as found:
        if len(found.sources) != 1:
            raise typer.BadParameter(f"{file} stands for {len(found.sources)} files; give one.")
        source = found.sources[0]
        try:
            if output is not None and is_same(output, source):
                raise InputError(f"{output} is the file to read; name another one to write.")
            if source.problem is not None:
                raise InputError(source.problem)
            if text := answer(opener.open(source.path)):
                typer.echo(text)
        except TopokitError as error:
            error.rename(str(source.path), source.name)
            say(opener.worded(error))
            raise typer.Exit(1) from error
