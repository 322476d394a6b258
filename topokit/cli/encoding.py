"""Output that any encoding can carry and any terminal may show: letters that cannot be are spelled in others."""

from __future__ import annotations

import codecs
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer
from typer.core import TyperGroup

from topokit.text import printable

_UsageError: Any = typer.BadParameter.__base__  # typer has its own copy of click, or not

_SPELLINGS = {
    **dict.fromkeys("−–—⁻━╸╺─", "-"),
    **dict.fromkeys("╭╮╰╯┌┐└┘├┤┬┴┼", "+"),
    **dict.fromkeys("“”", '"'),
    **dict.fromkeys("‘’", "'"),
    **dict(zip("·•█│⁰¹ᴷ⁽⁾×≈", ".*#|01K()x~", strict=True)),
    **{"…": "...", "→": "->", "≤": "<=", "≥": ">=", "≠": "!=", "±": "+-", "²": "^2", "³": "^3", "½": "1/2"},
    **{"χ": "chi", "τ": "tau", "σ": "sigma", "κ": "kappa", "π": "pi", "Σ": "sum", "∞": "inf", "°": " degrees"},
}


def use_encodable_letters() -> None:
    """Let standard output and standard error replace what their encodings lack, instead of failing."""
    codecs.register_error("topokit", _spelled)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="topokit")


class PrintableErrors(TyperGroup):
    """Commands whose usage errors may quote any name of a file."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Parse the options before the command."""
        with _printable_errors():
            return super().make_context(*args, **kwargs)

    def invoke(self, *args: Any, **kwargs: Any) -> Any:
        """Parse the options of the command and run it."""
        with _printable_errors():
            return super().invoke(*args, **kwargs)


@contextmanager
def _printable_errors() -> Iterator[None]:
    try:
        yield
    except _UsageError as error:
        error.message = printable(error.message)
        raise


def carries_all(encoding: str | None) -> bool:
    """Whether an encoding has every letter."""
    return (encoding or "").lower().replace("-", "").startswith("utf")


def _spelled(error: UnicodeError) -> tuple[str | bytes, int]:
    """The error handler: spellings of the letters that could not be encoded, escapes of those that have none."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    spelled = "".join(_SPELLINGS.get(letter, letter) for letter in lacking)
    return spelled.encode("ascii", "backslashreplace").decode("ascii"), error.end
