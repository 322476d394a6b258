"""Which form the results of a command take: one option for each form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer

from topokit.cli.bundle import Command, bundled
from topokit.cli.writers import Form

_HELP: dict[Form, str] = {
    "text": "The whole report of every shape.",
    "table": "One aligned row per shape; the default on a terminal if there are several.",
    "json": "One JSON array, an object per shape.",
    "jsonl": "One JSON object per line.",
    "csv": "Comma-separated values, a line per shape.",
}


def takes_form(*forms: Form) -> Callable[[Command], Command]:
    """A decorator that gives a command the options of these forms; the one that is given is its argument `form`."""
    options: dict[str, Any] = {
        form: Annotated[bool | None, typer.Option(f"--{form}", help=_HELP[form])] for form in forms
    }

    def chosen(**given: bool | None) -> Form | None:
        wanted = [form for form in forms if given[form]]
        if len(wanted) > 1:
            raise typer.BadParameter(f"{' and '.join(f'--{form}' for form in wanted)} exclude each other.")
        return wanted[0] if wanted else None

    return bundled("form", options, chosen)
